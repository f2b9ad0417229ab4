// SPDX-License-Identifier: Apache-2.0
// Every sub-command gets a signal at a random moment: it ends soon, its exit status says so, and
// no file is left half-written.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::milliseconds;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;
using testing::text_of;

// The program has one second (docs/commands.md). A machine that is shared with other tests may let
// it wait for a processor; what does not react at all takes 8 s to minutes.
constexpr milliseconds kSoon{4000};
constexpr double kLatestSignal_s = 2.0;

// FORCEGRID_STOP_TEST_SEED repeats a failure.
unsigned seed() {
  static const unsigned value = [] {
    const char* const given = std::getenv("FORCEGRID_STOP_TEST_SEED");
    return given != nullptr ? static_cast<unsigned>(std::stoul(given)) : std::random_device{}();
  }();
  return value;
}

// What the commands work on, each made when the first asks for it.
struct Workplace {
  std::string folder = fresh_folder("stop");
  std::string big_scene = folder + "/big.toml";

  Workplace() {
    ::setenv("XDG_CONFIG_HOME", folder.c_str(), 1);
    write_block(big_scene, 84);
  }
  ~Workplace() { fs::remove_all(folder); }

  std::string key() const {
    return made("link.key", [](const std::string& file) {
      Program keygen = Program::forcegrid({"keygen", file});
      EXPECT_EQ(keygen.wait(), 0) << keygen.standard_error();
    });
  }

  std::string recording() const {
    return made("recorded.h5", [this](const std::string& file) {
      Program run = Program::forcegrid({"record", file, "--scene", "small", "--seconds", "3",
                                        "--no-reference", "--out", folder});
      EXPECT_EQ(run.wait(), 0) << run.standard_error();
    });
  }

  std::string trace() const {
    return made("trace.csv", [](const std::string& name) {
      std::ofstream file(name);
      file << "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N\n";
      for (int i = 0; i < 200'000; ++i) {
        const double t_s = 1e-3 * i;
        const double z_m = 0.01 + 1e-3 * (i % 997) / 997.0;
        file << (i % 33 == 0 ? "sample," : "servo,") << t_s << ',' << (i % 33 == 0 ? t_s : 0.0)
             << ",0,0," << z_m << ",0,0," << -100.0 * z_m << '\n';
      }
    });
  }

  std::string mesh_scene() const { return made("mesh.toml", write_mesh); }

  // edge^3 vertices: 592,704, which load for some seconds.
  static void write_block(const std::string& file, int edge) {
    const std::string count = std::to_string(edge);
    std::ofstream(file)
        << "description = \"large\"\n[[object]]\nshape = \"block\"\nvertex_count = [" << count
        << ", " << count << ", " << count
        << "]\nsize_m = [0.1, 0.1, 0.1]\nstiffness_N_per_m = 10.0\n"
           "law = \"hardening\"\ncubic_coefficient = 5.0\n";
  }

  // A surface of 1,000,000 triangles in a file of 40 MB beside the scene.
  static void write_mesh(const std::string& scene) {
    constexpr int kEdge = 708;
    std::ofstream file(fs::path(scene).parent_path() / "mesh.obj");
    std::string text;
    for (int j = 0; j < kEdge; ++j) {
      for (int i = 0; i < kEdge; ++i) {
        text += "v " + std::to_string(1e-4 * i) + " " + std::to_string(1e-4 * j) + " " +
                std::to_string(0.01 + 1e-5 * ((i * 7 + j * 3) % 11)) + "\n";
      }
    }
    for (int j = 0; j + 1 < kEdge; ++j) {
      for (int i = 0; i + 1 < kEdge; ++i) {
        const int a = 1 + i + kEdge * j;
        text += "f " + std::to_string(a) + " " + std::to_string(a + 1) + " " +
                std::to_string(a + kEdge) + "\nf " + std::to_string(a + 1) + " " +
                std::to_string(a + 1 + kEdge) + " " + std::to_string(a + kEdge) + "\n";
      }
    }
    file << text;
    std::ofstream(scene)
        << "description = \"mesh\"\n[[object]]\nshape = \"mesh\"\nfile = \"mesh.obj\"\n"
           "unit = \"m\"\nfixed_below_m = 0.0\nstiffness_N_per_m = 10.0\nhome_stiffness_N_per_m = "
           "1.0\n"
           "law = \"linear\"\n";
  }

 private:
  std::string made(const std::string& name,
                   const std::function<void(const std::string&)>& make) const {
    const std::string file = folder + "/" + name;
    if (!fs::exists(file)) {
      make(file);
    }
    return file;
  }
};

Workplace& workplace() {
  static Workplace place;
  return place;
}

struct Case {
  std::string name;
  std::vector<std::string> (*command)(const Workplace& at, const std::string& out);
  bool short_lived = false;  ///< may have ended by itself before the signal
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Case& tested, std::ostream* out) { *out << tested.name; }

// An incomplete file of any kind would be noticed by its reader.
void expect_whole(const fs::path& file) {
  SCOPED_TRACE(file.string());
  const std::string name = file.filename().string();
  EXPECT_EQ(name.find(".partial-"), std::string::npos);
  EXPECT_FALSE(name.ends_with(".new"));
  const std::string text = text_of(file.string());
  const std::string tail = text.substr(text.size() - std::min<std::size_t>(text.size(), 40));
  if (name.ends_with(".json")) {
    EXPECT_TRUE(json::accept(text)) << tail;
  } else if (name.ends_with(".csv") || name.ends_with(".toml") || name.ends_with(".md")) {
    EXPECT_TRUE(text.ends_with('\n')) << tail;
  } else if (name.ends_with(".png")) {
    EXPECT_THAT(tail, HasSubstr("IEND"));
  } else if (name.ends_with(".svg")) {
    EXPECT_THAT(tail, HasSubstr("</svg>"));
  } else if (name.ends_with(".h5")) {
    Program python({"/usr/bin/python3", "-c",
                    "import h5py, sys; f = h5py.File(sys.argv[1], 'r'); "
                    "assert f.attrs['ended'] == b'by its writer', f.attrs['ended']",
                    file.string()});
    EXPECT_EQ(python.wait(), 0) << python.standard_error();
  }
}

class Stop : public ::testing::TestWithParam<Case> {};

TEST_P(Stop, EndsSoonAfterASignalAndLeavesNoHalfWrittenFile) {
  const Case& tested = GetParam();
  std::mt19937 random(seed() + static_cast<unsigned>(std::hash<std::string>{}(tested.name)));
  for (const int number : {SIGINT, SIGTERM}) {
    const double after_s = std::uniform_real_distribution<double>(0.0, kLatestSignal_s)(random);
    SCOPED_TRACE("FORCEGRID_STOP_TEST_SEED=" + std::to_string(seed()) + ": " + strsignal(number) +
                 " after " + std::to_string(after_s) + " s");
    const std::string out = fresh_folder("stop_" + tested.name);
    Program program = Program::forcegrid(tested.command(workplace(), out));
    std::this_thread::sleep_for(std::chrono::duration<double>(after_s));
    const bool ended_before = program.wait(milliseconds(0)).has_value();
    const auto signalled = std::chrono::steady_clock::now();
    if (!ended_before) {
      program.send_signal(number);
    }
    const auto status = program.wait(kSoon);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - signalled;
    ASSERT_TRUE(status.has_value()) << "still alive " << took.count() << " s after the signal\n"
                                    << program.standard_error();
    if (!tested.short_lived || (!ended_before && *status != 0)) {
      EXPECT_EQ(*status, 128 + number) << program.standard_error();
    }
    RecordProperty("seconds", std::to_string(took.count()));
    for (const auto& entry : fs::recursive_directory_iterator(out)) {
      if (entry.is_regular_file()) {
        expect_whole(entry.path());
      }
    }
    fs::remove_all(out);
  }
}

using Words = std::vector<std::string>;

const Case kCases[] = {
    {"run",
     [](const Workplace&, const std::string& out) {
       return Words{"run",   "--scene", "small",  "--seconds",          "0",
                    "--out", out,       "--json", out + "/summary.json"};
     }},
    {"run_that_loads",
     [](const Workplace& at, const std::string& out) {
       return Words{"run", "--scene", at.big_scene, "--out", out, "--json", out + "/summary.json"};
     }},
    {"run_with_workers",
     [](const Workplace&, const std::string& out) {
       return Words{"run", "--scene", "block", "--workers", "1", "--out", out};
     }},
    {"run_without_a_simulator",
     [](const Workplace&, const std::string& out) {
       return Words{"run", "--simulator", "127.0.0.1:9", "--out", out};
     }},
    {"run_of_a_falcon",
     [](const Workplace&, const std::string& out) {
       return Words{"run", "--device", "emulated:falcon", "--scene", "small", "--out", out};
     }},
    {"record",
     [](const Workplace&, const std::string& out) {
       return Words{"record", out + "/run.h5", "--scene", "small", "--seconds", "0", "--out", out};
     }},
    {"replay",
     [](const Workplace& at, const std::string& out) {
       return Words{"replay", at.recording(), "--out", out};
     }},
    {"plot",
     [](const Workplace& at, const std::string& out) {
       return Words{"plot", at.recording(), "--out", out};
     },
     true},
    {"evaluate",
     [](const Workplace& at, const std::string& out) {
       return Words{"evaluate", "--method", "forcegrid;kriging", "--trace",
                    at.trace(), "--out",    out + "/forces.csv"};
     },
     true},
    {"emulate",
     [](const Workplace&, const std::string&) {
       return Words{"emulate", "--device", "falcon", "--listen", "127.0.0.1:0"};
     }},
    {"simulate",
     [](const Workplace&, const std::string&) {
       return Words{"simulate", "--listen", "127.0.0.1:0"};
     }},
    {"simulate_that_loads",
     [](const Workplace& at, const std::string&) {
       return Words{"simulate", "--scene", at.big_scene, "--listen", "127.0.0.1:0"};
     }},
    {"simulate_bench",
     [](const Workplace&, const std::string& out) {
       return Words{"simulate", "--bench", "--json", out + "/bench.json"};
     }},
    {"worker",
     [](const Workplace& at, const std::string&) {
       return Words{"worker", "--connect", "tcp://127.0.0.1:9", "--key", at.key()};
     }},
    {"scene_of_a_mesh",
     [](const Workplace& at, const std::string&) {
       return Words{"scene", at.mesh_scene()};
     }},
    {"scene_return_test",
     [](const Workplace&, const std::string&) {
       return Words{"scene", "organ", "--return-test"};
     }},
    {"tune",
     [](const Workplace&, const std::string& out) {
       return Words{"tune", "--time", "60", "--scene", "small", "--out", out};
     }},
    {"calibrate",
     [](const Workplace&, const std::string& out) {
       return Words{"calibrate", "--device", "emulated:falcon",
                    "--yes",     "--write",  out + "/calibrated.toml"};
     }},
    {"devices", [](const Workplace&, const std::string&) { return Words{"devices"}; }, true},
    {"doctor",
     [](const Workplace&, const std::string& out) {
       return Words{"doctor", "--seconds", "10", "--json", out + "/doctor.json"};
     }},
    {"keygen",
     [](const Workplace&, const std::string& out) {
       return Words{"keygen", out + "/new.key"};
     },
     true},
    {"kinematics",
     [](const Workplace&, const std::string&) {
       return Words{"kinematics", "--profile", "falcon", "--position", "0,0,0"};
     },
     true},
    {"config", [](const Workplace&, const std::string&) { return Words{"config"}; }, true},
    {"chart_accuracy",
     [](const Workplace&, const std::string& out) {
       return Words{"chart", "accuracy", "--out", out, "--cache", out + "/cache"};
     }},
    {"chart_solvers",
     [](const Workplace&, const std::string& out) {
       return Words{"chart", "solvers", "--out", out};
     }},
    {"chart_wrist",
     [](const Workplace&, const std::string& out) {
       return Words{"chart", "wrist", "--out", out};
     }},
    {"chart_stability",
     [](const Workplace&, const std::string& out) {
       return Words{"chart", "stability", "--out", out, "--cache", out + "/cache"};
     }},
    {"paper",
     [](const Workplace&, const std::string& out) {
       return Words{"paper", "--out", out, "--cache", out + "/cache"};
     }},
};

INSTANTIATE_TEST_SUITE_P(Commands, Stop, ::testing::ValuesIn(kCases),
                         [](const auto& test) { return test.param.name; });

// A signal that no random moment may miss: while the scene of `run` loads, and its simulator says
// so.
TEST(StoppedCommand, SaysThatTheSceneLoads) {
  Program run = Program::forcegrid({"run", "--scene", workplace().mesh_scene(), "--seconds", "1",
                                    "--out", fresh_folder("stop_loading")});
  ASSERT_TRUE(run.wait_for_text("[simulator] loading " + workplace().mesh_scene(),
                                std::chrono::seconds(30)))
      << run.standard_error();
  run.send_signal(SIGTERM);
  ASSERT_EQ(run.wait(kSoon), 128 + SIGTERM) << run.standard_error();
  EXPECT_THAT(run.standard_error(),
              HasSubstr("forcegrid: stopped by SIGTERM while the simulator started"));
}

TEST(StoppedCommand, DoctorSaysThatItDidNotMeasure) {
  Program doctor = Program::forcegrid({"doctor", "--seconds", "60"});
  ASSERT_TRUE(doctor.wait_for_text("measuring wake-ups idle")) << doctor.standard_error();
  doctor.send_signal(SIGINT);
  ASSERT_EQ(doctor.wait(kSoon), 130) << doctor.standard_error();
  EXPECT_THAT(doctor.standard_output(), HasSubstr("wake-up idle: not measured: stopped by SIGINT"));
  EXPECT_THAT(doctor.standard_output(), HasSubstr("wake-up under load: not measured"));
  EXPECT_THAT(doctor.standard_error(), HasSubstr("forcegrid: stopped by SIGINT"));
}

}  // namespace
}  // namespace forcegrid
