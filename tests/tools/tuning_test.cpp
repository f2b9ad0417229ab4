// SPDX-License-Identifier: Apache-2.0
#include "tools/tuning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tools/config_file.h"
#include "tools/tuning_picture.h"

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;

TuningRow row(const std::string& method, double rate_Hz, double method_us, double error_percent) {
  TuningRow made;
  made.method = method;
  made.rate_Hz = rate_Hz;
  made.method_us = method_us;
  made.path_error_percent = made.error_percent = error_percent;
  made.measured = true;
  made.compute_p99_us = 10.0;
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

TEST(Tuning, TakesTheSmallerBudgetWhereCostsAreAlike) {
  std::vector<TuningRow> rows = {row("forcegrid", 500.0, 1.00, 0.5),
                                 row("forcegrid", 500.0, 1.05, 0.5)};
  rows[0].fill_budget = 3000;
  rows[1].fill_budget = 300;
  EXPECT_EQ(choose(rows, {.error_percent = 1.0}).chosen, 1u);
  rows[1].method_us = 2.0;
  EXPECT_EQ(choose(rows, {.error_percent = 1.0}).chosen, 0u);
}

TEST(Tuning, RefusesWhatMissesDeadlinesOrFillsItsPeriodOrIsUnstableOrFailed) {
  std::vector<TuningRow> rows = {row("a", 500.0, 1.0, 0.1), row("b", 500.0, 1.0, 0.1),
                                 row("c", 500.0, 1.0, 0.1), row("d", 500.0, 1.0, 0.1)};
  rows[0].missed_percent = 2.0;
  rows[1].compute_p99_us = 1200.0;
  rows[2].problem = "unplugged";
  rows[3].stability_margin = 0.8;
  const TuningTolerance tolerance;
  EXPECT_THAT(objection(rows[0], tolerance), HasSubstr("2 % of the deadlines missed"));
  EXPECT_THAT(objection(rows[1], tolerance), HasSubstr("60 % of its period"));
  EXPECT_EQ(objection(rows[2], tolerance), "unplugged");
  EXPECT_THAT(objection(rows[3], tolerance), HasSubstr("0.80 times the stiffness"));
  const TuningChoice choice = choose(rows, tolerance);
  EXPECT_FALSE(choice.chosen);
  EXPECT_THAT(choice.reason, HasSubstr("no setting meets the tolerance; nearest: a at 500 Hz"));
  rows[3].stability_margin = 1.2;
  EXPECT_EQ(choose(rows, tolerance).chosen, 3u);
}

TEST(Tuning, ProposesNothingThatTheLoopHasNotConfirmed) {
  std::vector<TuningRow> rows = {row("a", 500.0, 1.0, 0.1), row("b", 500.0, 2.0, 0.1)};
  rows[0].measured = false;
  EXPECT_EQ(choose(rows, {}).chosen, 1u);
  EXPECT_THAT(choose(rows, {}).reason, HasSubstr("a at 500 Hz: not measured in the loop"));
  rows[0].measured = true;
  rows[0].error_percent = 9.0;  // good on the path only
  EXPECT_EQ(choose(rows, {}).chosen, 1u);
  EXPECT_THAT(choose(rows, {}).reason, HasSubstr("error 9 % above 5 %"));
}

TEST(Tuning, NamesTheLeastOfEachKindAndTheNextSmallerThatIsNotGoodEnough) {
  const std::vector<TuningRow> rows = {row("kriging samples=4", 250.0, 1.0, 8.0),
                                       row("kriging samples=4", 500.0, 1.0, 7.9),
                                       row("kriging samples=8", 250.0, 2.0, 4.0),
                                       row("kriging samples=16", 250.0, 4.0, 3.0),
                                       row("forcegrid cells=13", 250.0, 1.0, 2.0),
                                       row("forcegrid", 250.0, 9.0, 1.0),
                                       row("rls", 250.0, 1.0, 1.0),
                                       row("forcegrid-mls cells=13", 250.0, 1.0, 6.0),
                                       row("forcegrid-mls", 250.0, 2.0, 7.0)};
  const std::vector<LeastVariant> leasts = least_variants(rows, {.error_percent = 5.0});
  ASSERT_EQ(leasts.size(), 2u);  // rls comes in one size, forcegrid-mls in none that will do
  EXPECT_EQ(leasts[0].least, 4u);
  EXPECT_FALSE(leasts[0].next_smaller);
  EXPECT_EQ(leasts[1].least, 2u);
  EXPECT_EQ(leasts[1].next_smaller, 0u);  // at the same rate
}

TEST(Tuning, DrawsAllPanelsAlsoOfMethodsWithoutAGrid) {
  const std::string folder = ::testing::TempDir() + "draw_tuning_" + std::to_string(getpid());
  std::filesystem::create_directories(folder);
  for (const char* method : {"forcegrid cells=13", "rls"}) {
    std::vector<TuningRow> rows = {row(method, 250.0, 1.0, 0.5), row(method, 500.0, 1.0, 0.4)};
    rows[1].measured = false;
    for (const std::string& file : draw_tuning(folder, rows, choose(rows, {}), {})) {
      EXPECT_GT(std::filesystem::file_size(file), 100u) << file;
    }
    std::ifstream csv(write_tuning_csv(folder, rows, choose(rows, {})));
    std::string head, first, second;
    std::getline(csv, head);
    std::getline(csv, first);
    std::getline(csv, second);
    EXPECT_THAT(first,
                HasSubstr(std::string("\"") + method + "\",250,1000,0.5,1,0.025,0,nan,1,0.5"));
    EXPECT_TRUE(first.ends_with(",1")) << "the chosen one";
    EXPECT_TRUE(second.ends_with(",nan,0")) << "not measured: " << second;
  }
  std::filesystem::remove_all(folder);
}

// gnuplot has no logarithm of zero; a row at the timer's floor says so.
TEST(Tuning, DrawsCostsErrorsAndTolerancesOfZero) {
  const std::string folder = ::testing::TempDir() + "draw_zero_" + std::to_string(getpid());
  std::filesystem::create_directories(folder);
  std::vector<TuningRow> rows = {row("hold", 250.0, 0.0, 20.0), row("rls", 250.0, 0.001, 0.0),
                                 row("linear", 250.0, 0.5, 1.0)};
  rows[1].timer_floor_us = 0.001;
  const TuningTolerance tolerance{.error_percent = 0.0};
  const TuningChoice choice = choose(rows, tolerance);
  ASSERT_EQ(choice.chosen, 1u);
  EXPECT_THAT(choice.reason, HasSubstr("its method taking at most 2.5e-05 % of a processor"));
  const auto files = draw_tuning(folder, rows, choice, tolerance);
  ASSERT_EQ(files.size(), 2u);
  for (const std::string& file : files) {
    EXPECT_GT(std::filesystem::file_size(file), 1000u) << file;
  }
  EXPECT_TRUE(rows[1].at_timer_floor());
  EXPECT_FALSE(rows[2].at_timer_floor());
  std::ifstream csv(write_tuning_csv(folder, rows, choice));
  std::ostringstream text;
  text << csv.rdbuf();
  EXPECT_THAT(text.str(), HasSubstr("\"rls\",250,1000,0,0.001,2.5e-05,1,"));
  std::filesystem::remove_all(folder);
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
