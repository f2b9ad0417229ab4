#include "tools/tuning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tools/config_file.h"

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;

TuningRow row(const std::string& method, double rate_Hz, double compute_us, double error_percent) {
  TuningRow made;
  made.method = method;
  made.rate_Hz = rate_Hz;
  made.compute_p50_us = compute_us;
  made.compute_p99_us = 2.0 * compute_us;
  made.error_percent = error_percent;
  return made;
}

TEST(Tuning, ChoosesTheCheapestThatIsGoodEnoughAndShowsTheNextCheaper) {
  // 0.05, 0.1, 0.5, 1 and 1 % of a processor.
  const std::vector<TuningRow> rows = {
      row("hold", 500.0, 1.0, 20.0), row("linear", 500.0, 2.0, 8.0), row("rls", 500.0, 10.0, 0.6),
      row("kriging", 500.0, 20.0, 0.04), row("rls", 1000.0, 10.0, 0.5)};
  const TuningChoice choice = choose(rows, {.error_percent = 1.0});
  ASSERT_EQ(choice.chosen, 2u);
  ASSERT_EQ(choice.next_cheaper, 1u);
  EXPECT_THAT(choice.reason, HasSubstr("rls at 500 Hz"));
  EXPECT_THAT(choice.reason, HasSubstr("next cheaper is linear at 500 Hz"));
  EXPECT_THAT(choice.reason, HasSubstr("error 8 % above 1 %"));
  EXPECT_EQ(choose(rows, {.error_percent = 0.1}).chosen, 3u);
  EXPECT_EQ(choose(rows, {.error_percent = 50.0}).chosen, 0u);
  EXPECT_FALSE(choose(rows, {.error_percent = 50.0}).next_cheaper);
}

TEST(Tuning, TakesTheLowerRateOfEquals) {
  const std::vector<TuningRow> rows = {row("rls", 1000.0, 5.0, 0.5), row("rls", 500.0, 10.0, 0.5)};
  EXPECT_EQ(choose(rows, {.error_percent = 1.0}).chosen, 1u);
}

TEST(Tuning, RefusesWhatMissesDeadlinesOrFillsItsPeriodOrFailed) {
  std::vector<TuningRow> rows = {row("a", 500.0, 1.0, 0.1), row("b", 500.0, 600.0, 0.1),
                                 row("c", 500.0, 1.0, 0.1)};
  rows[0].missed_percent = 2.0;
  rows[2].problem = "unplugged";
  const TuningTolerance tolerance;
  EXPECT_THAT(objection(rows[0], tolerance), HasSubstr("2 % of the deadlines missed"));
  EXPECT_THAT(objection(rows[1], tolerance), HasSubstr("60 % of its period"));
  EXPECT_EQ(objection(rows[2], tolerance), "unplugged");
  const TuningChoice choice = choose(rows, tolerance);
  EXPECT_FALSE(choice.chosen);
  EXPECT_THAT(choice.reason, HasSubstr("no setting meets the tolerance; nearest: a at 500 Hz"));
}

class UserFile : public ::testing::Test {
 protected:
  UserFile()
      : file_(::testing::TempDir() + "set_in_config_" + std::to_string(getpid()) + "/config.toml") {
    std::filesystem::remove_all(std::filesystem::path(file_).parent_path());
    std::filesystem::create_directories(std::filesystem::path(file_).parent_path());
  }
  void write(const std::string& text) const { std::ofstream(file_) << text; }
  std::string contents(const std::string& file) const {
    std::ifstream stream(file);
    std::ostringstream text;
    text << stream.rdbuf();
    return text.str();
  }
  std::string file_;
};

TEST_F(UserFile, KeepsEverythingElseAsItIs) {
  write("# mine\n[run]\nrate = 500  # old\nscene = \"small\"\n\n[evaluate]\nrate = 1\n");
  set_in_config(file_, {{"run.rate", "250"}, {"run.method", "\"rls\""}, {"tune.time", "60"}});
  EXPECT_EQ(contents(file_),
            "# mine\n[run]\nmethod = \"rls\"\nrate = 250\nscene = \"small\"\n\n[evaluate]\n"
            "rate = 1\n[tune]\ntime = 60\n");
  EXPECT_THAT(contents(file_ + ".old"), HasSubstr("rate = 500  # old"));
}

TEST_F(UserFile, IsMadeWhereThereIsNone) {
  set_in_config(file_, {{"run.rate", "250"}});
  EXPECT_EQ(contents(file_), "[run]\nrate = 250\n");
}

TEST_F(UserFile, StaysUntouchedWhereAKeyCantBeSet) {
  const std::string text = "run = { rate = 500 }\n";
  write(text);
  EXPECT_THROW(set_in_config(file_, {{"run.rate", "250"}}), ConfigError);
  EXPECT_EQ(contents(file_), text);
}

}  // namespace
}  // namespace forcegrid::tools
