// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <optional>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "link/servo_endpoint.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

/// A program with its standard output (and errors, if asked for) in a pipe; killed at the end.
class ChildProgram {
 public:
  explicit ChildProgram(std::vector<std::string> command) {
    int ends[2] = {-1, -1};
    if (::pipe2(ends, O_CLOEXEC) != 0) {
      throw std::runtime_error("no pipe");
    }
    output_ = ends[0];
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
    std::vector<char*> arguments;
    for (std::string& argument : command) {
      arguments.push_back(argument.data());
    }
    arguments.push_back(nullptr);
    const int error =
        ::posix_spawnp(&process_, arguments[0], &actions, nullptr, arguments.data(), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    if (error != 0) {
      throw std::runtime_error("can't start " + command[0]);
    }
  }
  ~ChildProgram() {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
    ::close(output_);
  }
  ChildProgram(const ChildProgram&) = delete;
  ChildProgram& operator=(const ChildProgram&) = delete;

  /// One line of output; what there is when the program ends or is silent for 30 s.
  std::string read_line() const {
    std::string line;
    char letter = '\0';
    pollfd entry = {output_, POLLIN, 0};
    while (::poll(&entry, 1, 30'000) == 1 && ::read(output_, &letter, 1) == 1 && letter != '\n') {
      line += letter;
    }
    return line;
  }

 private:
  pid_t process_ = -1;
  int output_ = -1;
};

struct Example {
  const char* name;
  std::vector<std::string> command;  ///< without the stiffness
  bool sealed = false;               ///< it gets a key file after the stiffness
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Example& example, std::ostream* out) { *out << example.name; }

constexpr const char* kPythonClient = FORCEGRID_SOURCE_DIR "/examples/spring_with_client.py";

class SpringExample : public testing::TestWithParam<Example> {
 public:
  ~SpringExample() override {
    if (!key_file_.empty()) {
      ::unlink(key_file_.c_str());
    }
  }

 protected:
  static constexpr double kStiffness_N_per_m = 250.0;
  static constexpr double kTolerance_N = 1e-12;  // rounding only

  std::string start() {
    std::vector<std::string> command = GetParam().command;
    command.push_back("250");
    if (GetParam().sealed) {
      key_file_ = testing::TempDir() + "spring_example_" + std::to_string(::getpid()) + ".key";
      LinkKey::generate(key_file_);
      command.push_back(key_file_);
    }
    child_ = std::make_unique<ChildProgram>(command);
    const std::string line = child_->read_line();
    const std::string expected = "listening on ";
    if (!line.starts_with(expected)) {
      throw std::runtime_error("unexpected output: " + line);
    }
    return line.substr(expected.size());
  }

  /// Moves the tool along a helix from `first_W_m` and checks each answer at the position that it
  /// states. The tool rests until the first answer, so that P0 is known.
  static void expect_a_spring(ServoEndpoint& servo, const Vector3& first_W_m) {
    int answers = 0;
    double largest_N = 0.0;
    const auto deadline = std::chrono::steady_clock::now() + 30s;
    for (std::uint32_t n = 1; answers < 8 && std::chrono::steady_clock::now() < deadline; ++n) {
      Vector3 position_W_m = first_W_m;
      if (answers > 0) {
        position_W_m[0] += 0.02 * std::sin(0.02 * n);
        position_W_m[1] += 0.02 * std::cos(0.02 * n);
        position_W_m[2] += 1e-5 * (n % 1000);
      }
      servo.send(ToolState{.sequence = n,
                           .servo_time_ns = 5'000'000 * std::int64_t{n},
                           .position_W_m = position_W_m});
      servo.wait(5ms);
      while (const auto sample = servo.receive()) {
        ++answers;
        EXPECT_TRUE(sample->in_contact && sample->converged && sample->has_stiffness);
        EXPECT_EQ(sample->contact_point_W_m, first_W_m);
        for (std::size_t i = 0; i < 3; ++i) {
          EXPECT_NEAR(sample->force_W_N[i],
                      -kStiffness_N_per_m * (sample->position_W_m[i] - first_W_m[i]), kTolerance_N);
          largest_N = std::max(largest_N, std::abs(sample->force_W_N[i]));
          for (std::size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(sample->stiffness_W_N_per_m[3 * i + k], i == k ? -kStiffness_N_per_m : 0.0);
          }
        }
      }
    }
    EXPECT_GE(answers, 8);
    EXPECT_GT(largest_N, 1.0);  // the tool did move: 0.02 m is 5 N
    EXPECT_EQ(servo.statistics().dropped(), 0U);
    EXPECT_EQ(servo.statistics().lost, 0U);
  }

  /// A servo of a new session, with the key of the example that was started.
  std::unique_ptr<ServoEndpoint> servo_at(const std::string& address) const {
    std::vector<LinkKey> keys;
    if (!key_file_.empty()) {
      keys.push_back(LinkKey::load(key_file_));
    }
    return std::make_unique<ServoEndpoint>(address, ServoEndpoint::random_session_id(),
                                           std::move(keys));
  }

  std::string key_file_;
  std::unique_ptr<ChildProgram> child_;
};

TEST_P(SpringExample, AnswersWithTheForceOfASpringAtTheStatedPosition) {
  const auto servo = servo_at(start());
  expect_a_spring(*servo, {0.001, -0.002, 0.003});
}

TEST_P(SpringExample, RestsAtTheNewFirstPositionInANewSession) {
  const std::string address = start();
  expect_a_spring(*servo_at(address), {0.001, 0.0, 0.0});
  expect_a_spring(*servo_at(address), {-0.001, 0.003, 0.0});
}

/// Those that show a client of all the protocol.
class ClientExample : public SpringExample {};

TEST_P(ClientExample, AnswersQueriesWhereTheyAsk) {
  const auto servo = servo_at(start());
  expect_a_spring(*servo, {0.0, 0.0, 0.001});
  const Vector3 asked_W_m = {0.002, -0.001, 0.004};
  std::optional<ForceSample> reply;
  std::uint32_t query_id = 0;
  for (int i = 0; i < 200 && !reply; ++i) {
    servo->send(Query{.query_id = ++query_id, .servo_time_ns = 7, .position_W_m = asked_W_m});
    servo->wait(100ms);
    while (const auto sample = servo->receive()) {
      reply = sample->query_id != 0 ? sample : reply;
    }
  }
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->position_W_m, asked_W_m);
  const Vector3 first_W_m = {0.0, 0.0, 0.001};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(reply->force_W_N[i], -kStiffness_N_per_m * (asked_W_m[i] - first_W_m[i]),
                kTolerance_N);
  }
}

TEST_P(SpringExample, IgnoresGarbage) {
  const std::string address = start();
  const Address parsed = parse_address(address, PortZero::kRefused);
  const int garbage = ::socket(AF_INET, SOCK_DGRAM, 0);
  ASSERT_GE(garbage, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(parsed.port);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (std::size_t size = 0; size < 600; ++size) {
    const std::vector<char> bytes(size, 'F');
    ::sendto(garbage, bytes.data(), size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  ::close(garbage);
  expect_a_spring(*servo_at(address), {0.0, 0.0, 0.0});
}

INSTANTIATE_TEST_SUITE_P(
    Link, SpringExample,
    testing::Values(Example{"Python",
                            {"python3", FORCEGRID_SOURCE_DIR "/examples/spring_simulator.py", "0"}},
                    Example{"Cpp", {FORCEGRID_SPRING_SIMULATOR, "127.0.0.1:0"}},
                    Example{"PythonClient", {"/usr/bin/python3", kPythonClient, "0"}},
                    Example{"PythonClientSealed", {"/usr/bin/python3", kPythonClient, "0"}, true},
                    Example{"C", {FORCEGRID_SPRING_SIMULATOR "_c", "0"}},
                    Example{"CSealed", {FORCEGRID_SPRING_SIMULATOR "_c_sealed", "0"}, true}),
    [](const auto& test) { return test.param.name; });

INSTANTIATE_TEST_SUITE_P(
    Link, ClientExample,
    testing::Values(Example{"Python", {"/usr/bin/python3", kPythonClient, "0"}},
                    Example{"PythonSealed", {"/usr/bin/python3", kPythonClient, "0"}, true},
                    Example{"C", {FORCEGRID_SPRING_SIMULATOR "_c", "0"}},
                    Example{"CSealed", {FORCEGRID_SPRING_SIMULATOR "_c_sealed", "0"}, true}),
    [](const auto& test) { return test.param.name; });

TEST(ClientExamples, RefuseAKeyThatOthersMayRead) {
  const std::string file = testing::TempDir() + "open_" + std::to_string(::getpid()) + ".key";
  ::unlink(file.c_str());
  LinkKey::generate(file);
  ASSERT_EQ(::chmod(file.c_str(), 0644), 0);
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"/usr/bin/python3", kPythonClient, "0", "250", file},
        std::vector<std::string>{FORCEGRID_SPRING_SIMULATOR "_c_sealed", "0", "250", file}}) {
    EXPECT_THAT(ChildProgram(command).read_line(), testing::HasSubstr("chmod 600"));
  }
}

TEST(PythonSpringExample, IsAtMostFortyLines) {
  std::ifstream file(FORCEGRID_SOURCE_DIR "/examples/spring_simulator.py");
  ASSERT_TRUE(file.is_open());
  int lines = 0;
  for (std::string line; std::getline(file, line);) {
    ++lines;
  }
  EXPECT_GT(lines, 10);
  EXPECT_LE(lines, 40);
}

TEST(ClientExamples, SayHowTheyAreCalled) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{}, {"port"}, {"24870", "stiff"}}) {
    std::vector<std::string> python{"/usr/bin/python3", kPythonClient};
    std::vector<std::string> c{FORCEGRID_SPRING_SIMULATOR "_c"};
    python.insert(python.end(), words.begin(), words.end());
    c.insert(c.end(), words.begin(), words.end());
    EXPECT_THAT(ChildProgram(python).read_line(), testing::HasSubstr("F = -k (P - P0)"));
    EXPECT_THAT(ChildProgram(c).read_line(), testing::HasSubstr("usage: spring_simulator_c PORT"));
  }
  EXPECT_THAT(ChildProgram({FORCEGRID_SPRING_SIMULATOR "_c", "99999"}).read_line(),
              testing::HasSubstr("0 to 65535"));
}

TEST(CppSpringExample, SaysWhyItDoesNotStart) {
  const auto first_line = [](std::vector<std::string> command) {
    return ChildProgram(std::move(command)).read_line();
  };
  EXPECT_THAT(first_line({FORCEGRID_SPRING_SIMULATOR}), testing::HasSubstr("usage:"));
  EXPECT_THAT(first_line({FORCEGRID_SPRING_SIMULATOR, "0.0.0.0:1"}),
              testing::HasSubstr("could move the motors"));
  EXPECT_THAT(first_line({FORCEGRID_SPRING_SIMULATOR, "127.0.0.1:0", "stiff"}),
              testing::HasSubstr("stiffness 'stiff'"));
}

}  // namespace
}  // namespace forcegrid::link
