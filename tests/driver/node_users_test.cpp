// SPDX-License-Identifier: Apache-2.0
// Who has a node open: of a made-up computer, and of this one.
#include "driver/node_users.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "driver/device.h"
#include "driver/node_lock.h"
#include "driver/usb_presence.h"

namespace forcegrid::driver {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class Folder : public testing::Test {
 public:
  ~Folder() override { fs::remove_all(root_); }

 protected:
  Folder() { fs::create_directories(root_); }

  void write(const std::string& file, const std::string& text) const {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }

  const fs::path root_ = testing::TempDir() + "node_users_" + std::to_string(::getpid());
};

/// A child that has a file open until the end of the object.
class Child {
 public:
  explicit Child(const std::string& file) {
    int ready[2];
    EXPECT_EQ(::pipe(ready), 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      const char done = ::open(file.c_str(), O_RDWR) >= 0 ? 'y' : 'n';
      static_cast<void>(!::write(ready[1], &done, 1));
      ::pause();
      ::_exit(0);
    }
    char done = 'n';
    EXPECT_EQ(::read(ready[0], &done, 1), 1);
    EXPECT_EQ(done, 'y');
    ::close(ready[0]);
    ::close(ready[1]);
  }
  ~Child() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  std::string pid() const { return std::to_string(pid_); }

 private:
  pid_t pid_ = -1;
};

using UsersOfNode = Folder;

TEST_F(UsersOfNode, AreNamedByWhatTheyHaveOpen) {
  write("dev/hidraw3", "");
  write("proc/100/comm", "steam\n");
  fs::create_directories(root_ / "proc/100/fd");
  fs::create_symlink("/dev/hidraw3", root_ / "proc/100/fd/12");
  write("proc/101/comm", "bash\n");
  fs::create_directories(root_ / "proc/101/fd");
  fs::create_symlink("/dev/hidraw30", root_ / "proc/101/fd/12");
  write("proc/self/comm", "not a number\n");
  const NodeUsers found = users_of_node("/dev/hidraw3", root_ / "dev/hidraw3", root_ / "proc");
  ASSERT_EQ(found.users.size(), 1U);
  EXPECT_FALSE(found.users[0].locks);
  EXPECT_EQ(found.hidden, 0);
  EXPECT_EQ(names_of(found.users), "process 100 (steam)");
  EXPECT_EQ(command_that_ends(found.users), "kill 100");
}

TEST_F(UsersOfNode, CountsProcessesThatMayNotBeLookedAtButNoKernelThreads) {
  if (::geteuid() == 0) {
    // Root may look at everything, so an ordinary user looks.
    write("dev/hidraw3", "");
    write("proc/2/stat", "2 (kthreadd) S 0 0 0 0 -1 2129984 0 0\n");
    write("proc/7/stat", "7 (a (b) c) S 1 7 7 0 -1 4194560 0 0\n");
    for (const char* pid : {"2", "7"}) {
      fs::create_directories(root_ / "proc" / pid / "fd");
      fs::permissions(root_ / "proc" / pid / "fd", fs::perms::none);
    }
    fs::permissions(root_, fs::perms::all);
    const pid_t child = ::fork();
    if (child == 0) {
      constexpr uid_t kNobody = 65534;
      const bool changed = ::setgid(kNobody) == 0 && ::setuid(kNobody) == 0;
      const NodeUsers found = users_of_node("/dev/hidraw3", root_ / "dev/hidraw3", root_ / "proc");
      ::_exit(changed && found.hidden == 1 && found.users.empty() ? 0 : 1 + found.hidden);
    }
    int status = -1;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(WEXITSTATUS(status), 0);
    for (const char* pid : {"2", "7"}) {
      fs::permissions(root_ / "proc" / pid / "fd", fs::perms::owner_all);
    }
  } else {
    // Process 1 is root's, and no kernel thread.
    write("dev/hidraw3", "");
    EXPECT_GE(users_of_node("/dev/hidraw3", root_ / "dev/hidraw3").hidden, 1);
  }
}

TEST_F(UsersOfNode, IsWhoeverHasItOpenOnARealKernel) {
  write("node", "");
  const std::string node = root_ / "node";
  EXPECT_TRUE(users_of_node(node, node).users.empty());
  const Child child(node);
  const NodeUsers found = users_of_node(node, node);
  ASSERT_EQ(found.users.size(), 1U);
  EXPECT_EQ(found.users[0].pid, child.pid());
}

using LockOfANodeInUse = Folder;

TEST_F(LockOfANodeInUse, IsRefusedWithTheProcessUnlessShared) {
  write("node", "");
  const std::string node = root_ / "node";
  {
    const Child child(node);
    try {
      const NodeLock lock(node);
      FAIL() << "locked";
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(),
                  HasSubstr("open " + node + ": this device is in use by process " + child.pid()));
      EXPECT_THAT(error.what(), HasSubstr("end it (kill " + child.pid() + "), or use --share"));
    }
    EXPECT_NO_THROW(NodeLock(node, true));
  }
  EXPECT_NO_THROW(const NodeLock lock(node));
}

// --- unplugged, or taken by another program ---

class TakenOrGone : public Folder {
 protected:
  TakenOrGone() {
    write("bus/usb/devices/1-2/devnum", "4\n");
    bind("usbhid");
  }
  void bind(const std::string& driver) const {
    const fs::path link = root_ / "bus/usb/devices/1-2:1.0/driver";
    fs::create_directories(link.parent_path());
    fs::remove(link);
    if (!driver.empty()) {
      fs::create_symlink("../../../../bus/usb/drivers/" + driver, link);
    }
  }
};

TEST_F(TakenOrGone, TellsWhichOfTheTwo) {
  const UsbPresence presence("1-2", "1-2:1.0", root_);
  bind("usbfs");
  EXPECT_EQ(presence.taken_by(), "usbfs");
  bind("");
  EXPECT_EQ(presence.taken_by(), "none");
  bind("usbhid");
  EXPECT_EQ(presence.taken_by(), "");  // the node's end has another cause
  write("bus/usb/devices/1-2/devnum", "5\n");
  bind("usbfs");
  EXPECT_EQ(presence.taken_by(), "");  // another device at that port
  fs::remove_all(root_ / "bus");
  EXPECT_EQ(presence.taken_by(), "");
}

TEST_F(TakenOrGone, WaitsUntilAnUnpluggedDeviceHasDisappeared) {
  const UsbPresence presence("1-2", "1-2:1.0", root_);
  bind("");  // the kernel takes the driver off first
  std::thread kernel([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    fs::remove_all(root_ / "bus/usb/devices/1-2");
  });
  EXPECT_EQ(presence.taken_by(), "");
  kernel.join();
}

TEST_F(TakenOrGone, IsGoneWhereThereIsNoUsb) {
  const UsbPresence presence("", "", root_);
  EXPECT_EQ(presence.taken_by(), "");
}

}  // namespace
}  // namespace forcegrid::driver
