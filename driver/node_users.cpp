// SPDX-License-Identifier: Apache-2.0
#include "driver/node_users.h"

#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "driver/sysfs_file.h"

namespace forcegrid::driver {
namespace {

namespace fs = std::filesystem;

constexpr unsigned long kKernelThread = 0x00200000;  // PF_KTHREAD of linux/sched.h

/// Processes with a lock on the file.
std::set<std::string> locking(const struct stat& status, const std::string& proc) {
  std::set<std::string> pids;
  char inode[64];
  std::snprintf(inode, sizeof inode, "%02x:%02x:%llu", major(status.st_dev), minor(status.st_dev),
                static_cast<unsigned long long>(status.st_ino));
  std::ifstream locks(proc + "/locks");
  for (std::string line; std::getline(locks, line);) {
    std::istringstream words(line);
    std::string number, kind, mandatory, access, pid, file;
    words >> number >> kind >> mandatory >> access >> pid >> file;
    if (kind == "FLOCK" && file == inode) {
      pids.insert(pid);
    }
  }
  return pids;
}

/// Whether the open file is the node, by its name or, of a device, by its numbers.
bool is_node(const fs::path& open_file, const std::string& node, const struct stat& status) {
  std::error_code error;
  if (fs::read_symlink(open_file, error) == fs::path(node)) {
    return true;
  }
  struct stat other {};
  return S_ISCHR(status.st_mode) && ::stat(open_file.c_str(), &other) == 0 &&
         S_ISCHR(other.st_mode) && other.st_rdev == status.st_rdev;
}

bool is_kernel_thread(const fs::path& process) {
  // "2 (name with any character) S ppid pgrp session tty tpgid flags ..."
  const std::string line = first_line(process / "stat");
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) {
    return false;
  }
  std::istringstream words(line.substr(name_end + 1));
  std::string state;
  long parent = 0;
  long group = 0;
  long session = 0;
  long terminal = 0;
  long terminal_group = 0;
  unsigned long flags = 0;
  words >> state >> parent >> group >> session >> terminal >> terminal_group >> flags;
  return (flags & kKernelThread) != 0;
}

}  // namespace

NodeUsers users_of_node(const std::string& node, const std::string& file, const std::string& proc) {
  NodeUsers found;
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) {
    return found;
  }
  const std::set<std::string> locked_by = locking(status, proc);
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(proc, error)) {
    const std::string pid = entry.path().filename().string();
    if (pid.empty() || std::isdigit(static_cast<unsigned char>(pid[0])) == 0 ||
        pid == std::to_string(::getpid())) {
      continue;
    }
    bool open = locked_by.contains(pid);
    std::error_code no_access;
    for (fs::directory_iterator fd(entry.path() / "fd", no_access), end; !no_access && fd != end;
         fd.increment(no_access)) {
      open = open || is_node(fd->path(), node, status);
    }
    if (open) {
      found.users.push_back({pid, first_line(entry.path() / "comm"), locked_by.contains(pid)});
    } else if (no_access == std::errc::permission_denied && !is_kernel_thread(entry.path())) {
      ++found.hidden;
    }
  }
  return found;
}

std::string names_of(const std::vector<NodeUser>& users) {
  std::string text;
  for (const NodeUser& user : users) {
    text += (text.empty() ? "process " : ", process ") + user.pid + " (" + user.name + ")";
  }
  return text;
}

std::string command_that_ends(const std::vector<NodeUser>& users) {
  std::string text = "kill";
  for (const NodeUser& user : users) {
    text += " " + user.pid;
  }
  return text;
}

}  // namespace forcegrid::driver
