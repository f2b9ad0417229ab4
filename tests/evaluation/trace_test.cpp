// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/trace.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

namespace forcegrid::evaluation {
namespace {

using ::testing::HasSubstr;

constexpr char kHeader[] = "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N\n";
constexpr char kLongHeader[] =
    "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N,j00_N_per_m,j01_N_per_m,j02_N_per_m,"
    "j10_N_per_m,j11_N_per_m,j12_N_per_m,j20_N_per_m,j21_N_per_m,j22_N_per_m,residual\n";

class TraceFile : public ::testing::Test {
 public:
  ~TraceFile() override { std::filesystem::remove_all(folder_); }

 protected:
  TraceFile() {
    const auto* const test = ::testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("trace_") + test->test_suite_name() + "_" + test->name();
    std::replace(name.begin(), name.end(), '/', '_');
    folder_ = std::filesystem::path(::testing::TempDir()) / name;
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }

  std::string file(const std::string& name) const { return (folder_ / name).string(); }

  std::string written(const std::string& name, const std::string& bytes) const {
    std::ofstream(file(name), std::ios::binary) << bytes;
    return file(name);
  }

  static std::string content(const std::string& path) {
    std::ifstream stream(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  std::string zipped(const std::string& name, const std::string& text) const {
    gzFile_s* const gz = gzopen(file(name).c_str(), "wb");
    EXPECT_EQ(gzwrite(gz, text.data(), static_cast<unsigned>(text.size())),
              static_cast<int>(text.size()));
    EXPECT_EQ(gzclose(gz), Z_OK);
    return file(name);
  }

  static std::string complaint(const std::string& path) {
    try {
      read_trace(path);
    } catch (const TraceError& error) {
      return error.what();
    }
    return "no complaint";
  }

  std::size_t files_in_folder() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder_),
                                                  std::filesystem::directory_iterator()));
  }

  std::filesystem::path folder_;
};

Trace random_trace(unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto vector = [&] {
    const double x = uniform(generator);
    const double y = uniform(generator);
    return Eigen::Vector3d(x, y, uniform(generator));
  };
  Trace trace;
  for (int i = 0; i < 300; ++i) {
    const double time_s = 1e6 + 0.002 * i;
    trace.servo.push_back({time_s, vector(), vector()});
    if (i % 17 == 0) {
      DeliveredSample row;
      row.sample.time_s = time_s;
      row.delivered_s = time_s + 0.0333;
      row.sample.position_W = vector();
      row.sample.force_W = vector();
      row.sample.has_stiffness = i % 2 == 0;
      if (row.sample.has_stiffness) {
        row.sample.stiffness_W << vector(), vector(), vector();
      }
      row.sample.relative_residual = 1e-4 * std::abs(uniform(generator));
      trace.samples.push_back(row);
    }
  }
  trace.events.push_back({1e6, true, vector(), 1e6 + 0.05});
  trace.events.push_back({1e6 + 0.2, false, Eigen::Vector3d::Zero(), std::nullopt});
  trace.events.push_back({1e6 + 0.3, true, vector(), std::nullopt});
  return trace;
}

TEST_F(TraceFile, ReadsBackExactlyWhatWasWrittenPlainOrZipped) {
  const unsigned seed = 20261121;
  SCOPED_TRACE("seed " + std::to_string(seed));
  const Trace before = random_trace(seed);
  for (const char* name : {"t.csv", "t.csv.gz"}) {
    SCOPED_TRACE(name);
    write_trace(file(name), before);
    const Trace after = read_trace(file(name));
    ASSERT_EQ(after.servo.size(), before.servo.size());
    for (std::size_t i = 0; i < before.servo.size(); ++i) {
      EXPECT_EQ(after.servo[i].time_s, before.servo[i].time_s);
      EXPECT_EQ(after.servo[i].position_W, before.servo[i].position_W);
      EXPECT_EQ(after.servo[i].force_W, before.servo[i].force_W);
    }
    ASSERT_EQ(after.samples.size(), before.samples.size());
    for (std::size_t i = 0; i < before.samples.size(); ++i) {
      const Sample& read = after.samples[i].sample;
      const Sample& given = before.samples[i].sample;
      EXPECT_EQ(after.samples[i].delivered_s, before.samples[i].delivered_s);
      EXPECT_EQ(read.time_s, given.time_s);
      EXPECT_EQ(read.position_W, given.position_W);
      EXPECT_EQ(read.force_W, given.force_W);
      EXPECT_EQ(read.has_stiffness, given.has_stiffness);
      EXPECT_EQ(read.stiffness_W, given.stiffness_W);
      EXPECT_EQ(read.relative_residual, given.relative_residual);
    }
    ASSERT_EQ(after.events.size(), before.events.size());
    for (std::size_t i = 0; i < before.events.size(); ++i) {
      EXPECT_EQ(after.events[i].time_s, before.events[i].time_s);
      EXPECT_EQ(after.events[i].made, before.events[i].made);
      EXPECT_EQ(after.events[i].point_W, before.events[i].point_W);
      EXPECT_EQ(after.events[i].delivered_s, before.events[i].delivered_s);
    }
  }
  EXPECT_LT(std::filesystem::file_size(file("t.csv.gz")),
            std::filesystem::file_size(file("t.csv")));
}

TEST_F(TraceFile, MeansWhatItsColumnsSay) {
  const Trace trace = read_trace(
      written("t.csv", std::string(kLongHeader) +
                           "contact,0.5,,0.1,0.2,0.3,,,,,,,,,,,,,\n"
                           "servo,1,,1,2,3,4,5,6,,,,,,,,,,\n"
                           "sample,0.75,1.25,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,1e-3\n"
                           "release,1.5,1.75,,,,,,,,,,,,,,,,\n"));
  ASSERT_EQ(trace.servo.size(), 1u);
  EXPECT_EQ(trace.servo[0].time_s, 1.0);
  EXPECT_EQ(trace.servo[0].position_W, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(trace.servo[0].force_W, Eigen::Vector3d(4, 5, 6));
  ASSERT_EQ(trace.samples.size(), 1u);
  EXPECT_EQ(trace.samples[0].delivered_s, 1.25);
  const Sample& sample = trace.samples[0].sample;
  EXPECT_EQ(sample.time_s, 0.75);
  EXPECT_EQ(sample.position_W, Eigen::Vector3d(7, 8, 9));
  EXPECT_EQ(sample.force_W, Eigen::Vector3d(10, 11, 12));
  EXPECT_TRUE(sample.has_stiffness);
  Eigen::Matrix3d row_major;
  row_major << 13, 14, 15, 16, 17, 18, 19, 20, 21;
  EXPECT_EQ(sample.stiffness_W, row_major);
  EXPECT_EQ(sample.relative_residual, 1e-3);
  ASSERT_EQ(trace.events.size(), 2u);
  EXPECT_TRUE(trace.events[0].made);
  EXPECT_EQ(trace.events[0].time_s, 0.5);
  EXPECT_EQ(trace.events[0].point_W, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_FALSE(trace.events[0].delivered_s.has_value());
  EXPECT_FALSE(trace.events[1].made);
  EXPECT_EQ(trace.events[1].delivered_s, 1.75);
}

TEST_F(TraceFile, TakesTheColumnsInAnyOrderAndWhatSpreadsheetsMakeOfThem) {
  const Trace trace = read_trace(
      written("t.csv",
              "\xEF\xBB\xBFt_s, kind ,fx_N,fy_N,fz_N,residual,delivered_s,x_m,y_m,z_m\r\n"
              "\r\n"
              "2, servo ,4,5,+6,,,1,2,-3e-1\r\n"
              "1,sample,4,5,6,,1.5,1,2,3"));
  ASSERT_EQ(trace.servo.size(), 1u);
  EXPECT_EQ(trace.servo[0].position_W, Eigen::Vector3d(1, 2, -0.3));
  EXPECT_EQ(trace.servo[0].force_W, Eigen::Vector3d(4, 5, 6));
  ASSERT_EQ(trace.samples.size(), 1u);
  EXPECT_FALSE(trace.samples[0].sample.has_stiffness);
}

TEST_F(TraceFile, PutsSamplesInTheOrderOfDelivery) {
  const Trace trace =
      read_trace(written("t.csv", std::string(kHeader) + "sample,0.1,0.9,0,0,0,1,0,0\n"
                                                         "sample,0.2,0.3,0,0,0,2,0,0\n"
                                                         "servo,0,,0,0,0,0,0,0\n"));
  ASSERT_EQ(trace.samples.size(), 2u);
  EXPECT_EQ(trace.samples[0].sample.force_W.x(), 2.0);
  EXPECT_EQ(trace.samples[1].sample.force_W.x(), 1.0);
}

struct Malformed {
  std::string name;
  std::string text;  // after one good servo row, on line 2, if it does not begin with a header
  std::vector<std::string> words;
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Malformed& malformed, std::ostream* out) { *out << malformed.name; }

class MalformedTrace : public TraceFile, public ::testing::WithParamInterface<Malformed> {};

TEST_P(MalformedTrace, IsRefusedWithLineAndColumn) {
  const std::string& text = GetParam().text;
  const bool whole = text.find("kind") != std::string::npos;
  const std::string path = written(
      "bad.csv", whole ? text : std::string(kHeader) + "servo,1,,0,0,0,0,0,0\n" + text + "\n");
  EXPECT_THAT(complaint(path), HasSubstr(path));
  for (const std::string& word : GetParam().words) {
    EXPECT_THAT(complaint(path), HasSubstr(word));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Rows, MalformedTrace,
    ::testing::Values(
        Malformed{"Text", "servo,2,,0,abc,0,0,0,0", {"line 3", "'y_m'", "number", "abc"}},
        Malformed{"HalfANumber", "servo,2,,0,0,0,0,0,1.5N", {"line 3", "'fz_N'", "1.5N"}},
        Malformed{"NotANumber", "servo,nan,,0,0,0,0,0,0", {"line 3", "'t_s'", "finite", "nan"}},
        Malformed{"Infinity", "servo,2,,0,0,0,inf,0,0", {"line 3", "'fx_N'", "finite", "inf"}},
        Malformed{"TooLarge", "servo,2,,0,0,0,1e999,0,0", {"line 3", "'fx_N'", "1e999", "double"}},
        Malformed{"EmptyForce", "servo,2,,0,0,0,0,,0", {"line 3", "'fy_N'", "empty"}},
        Malformed{"RubbishInAnUnusedColumn", "servo,2,?,0,0,0,0,0,0", {"line 3", "'delivered_s'"}},
        Malformed{
            "TooFewFields", "servo,2,,0,0,0,0,0", {"line 3", "'fz_N'", "9 fields", "found 8"}},
        Malformed{"TooManyFields",
                  "servo,2,,0,0,0,0,0,0,0",
                  {"line 3", "9 fields", "'fz_N'", "found 10"}},
        Malformed{"UnknownKind", "serve,2,,0,0,0,0,0,0", {"line 3", "'kind'", "serve", "release"}},
        Malformed{"TimeGoesBack", "servo,0.5,,0,0,0,0,0,0", {"line 3", "'t_s'", "1 s", "0.5"}},
        Malformed{"TimeStandsStill", "servo,1,,0,0,0,0,0,0", {"line 3", "'t_s'", "more than 1 s"}},
        Malformed{"DeliveredBeforeItsTime",
                  "sample,2,1.9,0,0,0,0,0,0",
                  {"line 3", "'delivered_s'", "2 s or later", "1.9"}},
        Malformed{"NeverDelivered", "sample,2,,0,0,0,0,0,0", {"line 3", "'delivered_s'", "empty"}},
        Malformed{"ContactsGoBack",
                  "contact,2,,0,0,0,,,\nrelease,1.5,,,,,,,",
                  {"line 4", "'t_s'", "2 s or more", "1.5"}},
        Malformed{"ContactWithoutAPoint", "contact,2,,0,0,,,,", {"line 3", "'z_m'", "empty"}},
        Malformed{"ContactKnownBeforeItWas",
                  "contact,2,1,0,0,0,,,",
                  {"line 3", "'delivered_s'", "2 s or later"}},
        Malformed{"UnknownColumn",
                  "kind,t_s,delivered_s,x_mm,y_m,z_m,fx_N,fy_N,fz_N\n",
                  {"line 1", "column 4", "x_mm", "x_m"}},
        Malformed{"MissingColumn",
                  "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N\n",
                  {"line 1", "'fz_N'", "missing"}},
        Malformed{"ColumnTwice",
                  "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N,t_s\n",
                  {"line 1", "'t_s'", "twice"}},
        Malformed{"PartOfAStiffness",
                  "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N,j00_N_per_m\n",
                  {"line 1", "'j01_N_per_m'", "nine"}},
        Malformed{"PartlyEmptyStiffness",
                  std::string(kLongHeader) + "sample,0,0,0,0,0,0,0,0,1,2,3,4,5,6,7,8,,\n",
                  {"line 2", "'j22_N_per_m'", "nine"}},
        Malformed{"NegativeResidual",
                  std::string(kLongHeader) + "sample,0,0,0,0,0,0,0,0,,,,,,,,,,-1\n",
                  {"line 2", "'residual'", "zero or more", "-1"}},
        Malformed{"OnlyAHeader", kHeader, {"servo", "reference forces"}}),
    [](const auto& test) { return test.param.name; });

TEST_F(TraceFile, NamesAFileThatIsNotThereOrNoFile) {
  EXPECT_THAT(complaint(file("none.csv")), HasSubstr("none.csv: can't be read (No such file"));
  EXPECT_THAT(complaint(folder_.string()), HasSubstr(folder_.string()));
  EXPECT_THAT(complaint(written("empty.csv", "")), HasSubstr("empty"));
  EXPECT_THAT(complaint(written("empty.csv.gz", "")), HasSubstr("empty"));
}

TEST_F(TraceFile, SaysWhenItsNameAndItsContentDisagreeAboutGzip) {
  const std::string text = std::string(kHeader) + "servo,1,,0,0,0,0,0,0\n";
  EXPECT_THAT(complaint(written("t.csv.gz", text)), HasSubstr("not gzipped"));
  EXPECT_THAT(complaint(zipped("t.csv", text)), HasSubstr("add .gz"));
  EXPECT_EQ(read_trace(zipped("good.csv.gz", text)).servo.size(), 1u);
}

TEST_F(TraceFile, NoticesAGzippedFileThatWasCutOffOrDamaged) {
  write_trace(file("whole.csv.gz"), random_trace(7));
  const std::string bytes = content(file("whole.csv.gz"));
  ASSERT_GT(bytes.size(), 5000u);
  for (std::size_t kept = 0; kept < bytes.size(); kept += 97) {
    EXPECT_NE(complaint(written("cut.csv.gz", bytes.substr(0, kept))), "no complaint") << kept;
  }
  for (const std::size_t missing : {1u, 4u, 8u, 9u, 100u}) {
    const std::string cut = bytes.substr(0, bytes.size() - missing);
    EXPECT_THAT(complaint(written("cut.csv.gz", cut)), HasSubstr("truncated")) << missing;
  }
  std::string damaged = bytes;
  damaged[damaged.size() - 6] = static_cast<char>(damaged[damaged.size() - 6] ^ 1);  // the CRC
  EXPECT_THAT(complaint(written("damaged.csv.gz", damaged)), HasSubstr("incorrect data check"));
}

TEST_F(TraceFile, RefusesALineWithoutEnd) {
  EXPECT_THAT(complaint(written("t.csv", std::string(kHeader) + std::string(200'000, '1'))),
              HasSubstr("line 2 is longer than"));
}

TEST_F(TraceFile, IsNotWrittenWhenItCouldNotBeReadAgain) {
  const auto complaint_of = [&](const Trace& trace) {
    try {
      write_trace(file("t.csv"), trace);
    } catch (const TraceError& error) {
      return std::string(error.what());
    }
    return std::string("no complaint");
  };
  Trace trace = random_trace(1);
  trace.servo[3].force_W.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(complaint_of(trace), HasSubstr("servo instant 3 is not finite"));
  trace = random_trace(1);
  trace.servo[4].time_s = trace.servo[3].time_s;
  EXPECT_THAT(complaint_of(trace), HasSubstr("servo instant 4 is not later"));
  trace = random_trace(1);
  trace.samples[2].delivered_s = trace.samples[2].sample.time_s - 1.0;
  EXPECT_THAT(complaint_of(trace), HasSubstr("sample 2 arrives before"));
  trace = random_trace(1);
  std::swap(trace.events[0], trace.events[1]);
  EXPECT_THAT(complaint_of(trace), HasSubstr("contact event 1 is out of order"));
  EXPECT_THAT(complaint_of(Trace{}), HasSubstr("no servo instant"));
  EXPECT_EQ(files_in_folder(), 0u);
}

// A limit on the size of files does to a write what a full disk does: it fails half way.
class SmallFiles {
 public:
  explicit SmallFiles(rlim_t bytes) {
    before_signal_ = signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SmallFiles() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, before_signal_);
  }
  SmallFiles(const SmallFiles&) = delete;
  SmallFiles& operator=(const SmallFiles&) = delete;

 private:
  rlimit before_{};
  void (*before_signal_)(int) = nullptr;
};

TEST_F(TraceFile, LeavesWhatWasThereWhenTheDiskIsFull) {
  const Trace trace = random_trace(1);
  for (const char* name : {"t.csv", "t.csv.gz"}) {
    const std::string path = written(name, "old");
    std::string said = "no complaint";
    {
      const SmallFiles limit(1000);
      try {
        write_trace(path, trace);
      } catch (const TraceError& error) {
        said = error.what();
      }
    }
    EXPECT_THAT(said, HasSubstr(path));
    EXPECT_THAT(said, HasSubstr("File too large"));
    EXPECT_EQ(content(path), "old");
    std::filesystem::remove(path);
    EXPECT_EQ(files_in_folder(), 0u) << "something half written was left";
    write_trace(path, trace);
    EXPECT_EQ(read_trace(path).servo.size(), trace.servo.size());
    std::filesystem::remove(path);
  }
}

TEST_F(TraceFile, IsNotWrittenOverWhatIsNoPlainFile) {
  const Trace trace = random_trace(1);
  for (const std::string& path : {std::string("/dev/full"), folder_.string()}) {
    EXPECT_THROW(write_trace(path, trace), TraceError) << path;
  }
  EXPECT_THROW(write_trace(file("no-such-folder/t.csv"), trace), TraceError);
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/full"));
}

}  // namespace
}  // namespace forcegrid::evaluation
