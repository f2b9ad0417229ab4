// SPDX-License-Identifier: Apache-2.0
// `forcegrid evaluate` as its user starts it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "evaluation/judge/baseline_cost.h"
#include "evaluation/traces/pair_trace.h"
#include "evaluation/traces/trace.h"
#include "tests/evaluation/pair_ramp.h"
#include "tests/evaluation/ramp_trace.h"
#include "tests/support/program.h"
#include "text/text.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::PairRamp;
using testing::Program;
using testing::Ramp;

constexpr std::chrono::seconds kPatience{60};

class Evaluate : public ::testing::Test {
 protected:
  std::string written(const evaluation::Trace& trace) {
    const std::string file = folder_ + "/trace.csv.gz";
    evaluation::write_trace(file, trace);
    return file;
  }

  // Runs the command, expecting `status`.
  void run(std::vector<std::string> arguments, int status) {
    arguments.insert(arguments.begin(), "evaluate");
    Program program = Program::forcegrid(arguments);
    EXPECT_EQ(program.wait(kPatience), status);
    out_ = program.standard_output();
    error_ = program.standard_error();
  }

  json result(std::vector<std::string> arguments) {
    run(std::move(arguments), 0);
    json parsed = json::parse(out_, nullptr, false);
    EXPECT_TRUE(parsed.is_object()) << out_ << error_;
    return parsed;
  }

  const std::string folder_ = fresh_folder("evaluate");
  std::string out_;
  std::string error_;
};

TEST_F(Evaluate, PrintsAFlatObjectForOneMethod) {
  const Ramp ramp;
  const json figures = result({"--method", "hold", "--trace", written(ramp.trace())});
  for (const char* key :
       {"rms_error_percent_after_1s", "rms_error_percent_first_1s", "max_error_percent_after_1s",
        "query_ns_median", "sample_us_median", "memory_bytes"}) {
    ASSERT_TRUE(figures.contains(key) && figures[key].is_number()) << key;
  }
  // The largest age of a sample is 38 ms, and F_o grows with time: see judge_test.cpp.
  const double last = ramp.cycles() - 1.0;
  const double rms_s =
      0.002 * std::sqrt(last * (last + 1.0) * (2.0 * last + 1.0) / 6.0 / ramp.cycles());
  EXPECT_NEAR(figures["max_error_percent_after_1s"].get<double>(), 100.0 * 0.038 / rms_s, 1e-6);
  EXPECT_EQ(error_, "");
}

TEST_F(Evaluate, KeepsABudgetAndCountsWhatItCouldNotPayFor) {
  // 50 samples a second with stiffness: more than a budget for 30 without reckons with.
  const std::string trace = written(Ramp{}.trace());
  // 80 bare reads of this machine: 23 are the least, and 154 do not pay for all samples yet.
  const double budget_ns = std::round(80.0 * evaluation::bare_trilinear_read_ns());
  const std::string budget_us = text::number_text(1e-3 * budget_ns);
  const json figures = result({"--method", "auto", "--budget-us", budget_us, "--trace", trace});
  EXPECT_GT(figures["counters"]["samples_over_budget"], 0) << out_;
  EXPECT_THAT(error_, HasSubstr(budget_us + " us a cycle, which is "));
  const json without = result({"--method", "auto", "--trace", trace});
  EXPECT_GT(without["memory_bytes"].get<double>(), figures["memory_bytes"].get<double>());
  EXPECT_FALSE(without["counters"].contains("samples_over_budget")) << out_;
}

TEST_F(Evaluate, RefusesABudgetThatNoMethodKeepsOrThatPaysForNothing) {
  const std::string trace = written(Ramp{}.trace());
  run({"--method", "rls", "--budget-us", "1", "--trace", trace}, 2);
  EXPECT_THAT(error_, HasSubstr("only method auto keeps a budget"));
  run({"--method", "auto", "--budget-us", "0.01", "--trace", trace}, 2);
  EXPECT_THAT(error_, HasSubstr("give at least"));
}

// The configuration serves every method, so that a budget in it must not keep others from running.
TEST_F(Evaluate, SaysThatABudgetOfTheConfigurationHasNoEffectOnOtherMethods) {
  const std::string config = folder_ + "/config.toml";
  std::ofstream(config) << "[evaluate]\nbudget-us = 1\n";
  Program program = Program::forcegrid(
      {"--config", config, "evaluate", "--method", "rls", "--trace", written(Ramp{}.trace())});
  EXPECT_EQ(program.wait(kPatience), 0);
  EXPECT_THAT(program.standard_error(), HasSubstr("budget-us of the configuration has no effect"));
}

TEST_F(Evaluate, PrintsAnObjectKeyedByMethodForSeveral) {
  const json figures = result({"--method", "hold", "--method", "forcegrid  unit=m", "--method",
                               "tangent", "--method", "hold", "--trace", written(Ramp{}.trace())});
  std::vector<std::string> names;
  for (const auto& [name, value] : figures.items()) {
    names.push_back(name);
    EXPECT_TRUE(value.at("rms_error_percent_after_1s").is_number()) << name;
  }
  EXPECT_THAT(names, ElementsAre("forcegrid unit=m", "hold", "tangent"));
  EXPECT_LT(figures["tangent"]["rms_error_percent_after_1s"].get<double>(), 1e-6);
}

TEST_F(Evaluate, TakesTheDefaultWorkspaceOnlyIfItHoldsTheTrace) {
  Ramp ramp;
  const std::vector<double> standard = {0.0, 0.0, 0.0, 0.16, 0.12, 0.12};
  EXPECT_EQ(result({"--method", "hold", "--trace", written(ramp.trace())})["workspace_m"],
            json(standard));
  ramp.start_W = Eigen::Vector3d(-0.01, 0.06, 0.06);
  const json grown = result({"--method", "forcegrid", "--trace", written(ramp.trace())});
  const auto box = grown["workspace_m"].get<std::vector<double>>();
  const Eigen::Vector3d end_W = ramp.position_W(ramp.cycles() - 1);
  for (int axis = 0; axis < 3; ++axis) {
    const auto low = static_cast<std::size_t>(axis);
    EXPECT_NEAR(box.at(low), ramp.start_W[axis] - 0.03, 1e-9);
    EXPECT_NEAR(box.at(low + 3), end_W[axis] + 0.03, 1e-9);
  }
  EXPECT_EQ(grown["cycles_outside_workspace"], 0);
}

TEST_F(Evaluate, SaysWhenTheWorkspaceAskedForDoesNotHoldTheTrace) {
  const json figures = result({"--method", "forcegrid", "--workspace", "0,0,0,0.06,0.12,0.12",
                               "--trace", written(Ramp{}.trace())});
  EXPECT_GT(figures["cycles_outside_workspace"].get<int>(), 0);
  EXPECT_THAT(error_, HasSubstr("outside --workspace"));
}

// What a flag and a variant's word say must come to the same, and the word wins.
TEST_F(Evaluate, TakesParametersAsFlagsAndAsWordsOfAMethod) {
  const std::string trace = written(Ramp{}.trace());
  const auto error_with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--trace", trace});
    return result(arguments)["rms_error_percent_after_1s"].get<double>();
  };
  const double standard = error_with({"--method", "forcegrid"});
  const std::vector<std::vector<std::string>> flags = {
      {"--unit", "m"}, {"--r", "0.01"}, {"--s", "1"}, {"--cells", "20,21,22"}};
  const std::vector<std::string> words = {"unit=m", "r=10mm", "s=1", "cells=20,21,22"};
  for (std::size_t i = 0; i < flags.size(); ++i) {
    SCOPED_TRACE(words[i]);
    std::vector<std::string> arguments = {"--method", "forcegrid"};
    arguments.insert(arguments.end(), flags[i].begin(), flags[i].end());
    const double flagged = error_with(arguments);
    EXPECT_NE(flagged, standard);
    EXPECT_EQ(flagged, error_with({"--method", "forcegrid " + words[i]}));
  }
  EXPECT_EQ(error_with({"--method", "forcegrid", "--r", "10mm"}),
            error_with({"--method", "forcegrid", "--r", "0.01"}));
  EXPECT_EQ(error_with({"--method", "forcegrid unit=mm", "--unit", "m"}), standard);
  // A sixth of the workspace's x extent is the default of r.
  EXPECT_EQ(error_with({"--method", "forcegrid", "--r", "26.666666666666668mm"}), standard);
}

TEST_F(Evaluate, WritesTheForces) {
  const Ramp ramp;
  const std::string file = folder_ + "/forces.csv";
  result(
      {"--method", "hold", "--method", "tangent", "--trace", written(ramp.trace()), "--out", file});
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  EXPECT_EQ(line,
            "t_s,x_m,y_m,z_m,offline_x_N,offline_y_N,offline_z_N,hold_x_N,hold_y_N,hold_z_N,"
            "tangent_x_N,tangent_y_N,tangent_z_N");
  int cycle = 0;
  for (; std::getline(stream, line); ++cycle) {
    std::istringstream cells(line);
    std::vector<double> values;
    for (std::string cell; std::getline(cells, cell, ',');) {
      values.push_back(std::stod(cell));
    }
    ASSERT_EQ(values.size(), 13u);
    EXPECT_DOUBLE_EQ(values[0], ramp.time_s(cycle));
    EXPECT_NEAR(values[4], ramp.force_W(cycle).x(), 1e-12);
    if (cycle >= 10) {  // hold: the sample before the last, 20 to 38 ms old
      EXPECT_NEAR(values[7], ramp.force_W(cycle / 10 * 10 - 10).x(), 1e-12);
      EXPECT_NEAR(values[10], ramp.force_W(cycle).x(), 1e-9);
    }
  }
  EXPECT_EQ(cycle, ramp.cycles());
}

TEST_F(Evaluate, RefusesMethodsThatATraceCannotServe) {
  const std::string trace = written(Ramp{}.trace());
  run({"--method", "direct", "--trace", trace}, 2);
  EXPECT_THAT(error_, HasSubstr("'direct' is the simulator itself"));
  run({"--method", "tangent", "--no-stiffness", "--trace", trace}, 2);
  EXPECT_THAT(error_, HasSubstr("'tangent' needs the samples' stiffness"));
  Ramp forces_only;
  forces_only.send_stiffness = false;
  run({"--method", "hold", "--method", "tangent", "--trace", written(forces_only.trace())}, 1);
  EXPECT_THAT(error_, HasSubstr("no sample has a stiffness"));
  EXPECT_EQ(out_, "");
}

TEST_F(Evaluate, EndsWithStatus2WhenItIsAskedWrongly) {
  const std::string trace = written(Ramp{}.trace());
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{"--trace", trace}, "--method"},
      {{"--method", "hold"}, "--trace"},
      {{"--method", "magic", "--trace", trace}, "known methods: "},
      {{"--method", "forcegrid unit=fathom", "--trace", trace}, "unit=fathom"},
      {{"--method", "forcegrid", "--unit", "fathom", "--trace", trace}, "unit=fathom"},
      {{"--method", "forcegrid", "--cells", "0", "--trace", trace}, "cells=0"},
      {{"--method", "forcegrid", "--r", "1 mile", "--trace", trace}, "r=1"},
      {{"--method", "forcegrid", "--weight", "heavy", "--trace", trace}, "idw4"},
      {{"--method", "hold", "--workspace", "0,0,0,1,1", "--trace", trace}, "--workspace"},
      {{"--method", "hold", "--workspace", "1,0,0,0,1,1", "--trace", trace}, "--workspace"},
      {{"--method", "hold", "--workspace", "nan,0,0,1,1,1", "--trace", trace}, "--workspace"},
      {{"--method", "hold", "--trace", trace, "--trac", trace}, "--trac"}};
  for (const auto& [arguments, word] : wrong) {
    run(arguments, 2);
    EXPECT_THAT(error_ + out_, HasSubstr(word));
    EXPECT_EQ(out_.find("rms_error"), std::string::npos);
  }
}

TEST_F(Evaluate, EndsWithStatus1WhenTheTraceOrTheOutputIsNotUsable) {
  run({"--method", "hold", "--trace", folder_ + "/none.csv"}, 1);
  EXPECT_THAT(error_, HasSubstr("none.csv"));
  const std::string bad = folder_ + "/bad.csv";
  std::ofstream(bad) << "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N\n"
                        "servo,0,,0,0,0,0,0,0\n"
                        "servo,0.002,,0,0,0,0,zero,0\n";
  run({"--method", "hold", "--trace", bad}, 1);
  EXPECT_THAT(error_, HasSubstr("bad.csv, line 3: column 'fy_N'"));
  EXPECT_EQ(out_, "");
  run({"--method", "hold", "--trace", written(Ramp{}.trace()), "--out", "/dev/full"}, 1);
  EXPECT_THAT(error_, HasSubstr("/dev/full"));
}

TEST_F(Evaluate, SaysWhenATraceLeavesFiguresOpen) {
  Ramp ramp;
  ramp.seconds = 0.5;
  json figures = result({"--method", "hold", "--trace", written(ramp.trace())});
  EXPECT_TRUE(figures["rms_error_percent_after_1s"].is_null());
  EXPECT_THAT(error_, HasSubstr("is not longer than one second"));
  ramp.stiffness_N_per_m = 0.0;
  figures = result({"--method", "hold", "--trace", written(ramp.trace())});
  EXPECT_TRUE(figures["rms_error_percent_first_1s"].is_null());
  EXPECT_THAT(error_, HasSubstr("has only zero reference forces"));
  evaluation::Trace silent = Ramp{}.trace();
  silent.samples.clear();
  figures = result({"--method", "hold", "--trace", written(silent)});
  EXPECT_EQ(figures["samples_taken"], 0);
  EXPECT_TRUE(figures["sample_us_median"].is_null());
  EXPECT_THAT(error_, HasSubstr("no 'sample' row"));
}

class EvaluatePair : public Evaluate {
 protected:
  std::string pair(const evaluation::PairTrace& trace) {
    const std::string file = folder_ + "/pair.csv.gz";
    evaluation::write_pair_trace(file, trace);
    return file;
  }
};

TEST_F(EvaluatePair, PrintsTheErrorsOfBothToolsTogetherAndOfEach) {
  const PairRamp ramp;
  const json figures = result({"--method", "hold", "--trace", pair(ramp.trace())});
  // The oldest sample is 19 cycles old, and the reference grows with time: see pair_judge_test.cpp.
  const double last = ramp.cycles() - 1.0;
  const double rms_s =
      0.002 * std::sqrt(last * (last + 1.0) * (2.0 * last + 1.0) / 6.0 / ramp.cycles());
  const double expected = 100.0 * 0.038 / rms_s;
  EXPECT_NEAR(figures["max_error_percent_after_1s"].get<double>(), expected, 1e-6);
  ASSERT_EQ(figures["tools"].size(), 2U);
  for (const json& tool : figures["tools"]) {
    EXPECT_NEAR(tool["max_error_percent_after_1s"].get<double>(), expected, 1e-6);
  }
  EXPECT_EQ(figures["coupled"], false);
  EXPECT_EQ(figures["samples_taken"], 99);
  EXPECT_GT(figures["memory_bytes"].get<double>(), 0.0);
  EXPECT_EQ(error_, "");
}

TEST_F(EvaluatePair, KnowsMethodsOfBothToolsBesideThoseOfEach) {
  const json figures = result({"--method", "kriging-6d", "--method", "auto-6d samples=16",
                               "--method", "rls", "--trace", pair(PairRamp{}.trace())});
  EXPECT_EQ(figures.at("kriging-6d").at("coupled"), true);
  EXPECT_EQ(figures.at("rls").at("coupled"), false);
  // A linear object: all of its error is the noise that the methods expect.
  EXPECT_LT(figures.at("kriging-6d").at("rms_error_percent_after_1s").get<double>(), 0.1);
  EXPECT_LT(figures.at("auto-6d samples=16").at("rms_error_percent_after_1s").get<double>(), 0.1);
}

TEST_F(EvaluatePair, WritesTheForcesOfBothTools) {
  const std::string out = folder_ + "/forces.csv";
  result({"--method", "hold", "--trace", pair(PairRamp{}.trace()), "--out", out});
  std::ifstream file(out);
  std::string header;
  std::getline(file, header);
  EXPECT_EQ(header,
            "t_s,p1x_m,p1y_m,p1z_m,p2x_m,p2y_m,p2z_m,offline_1x_N,offline_1y_N,offline_1z_N,"
            "offline_2x_N,offline_2y_N,offline_2z_N,hold_1x_N,hold_1y_N,hold_1z_N,hold_2x_N,"
            "hold_2y_N,hold_2z_N");
  int rows = 0;
  for (std::string line; std::getline(file, line);) {
    ++rows;
  }
  EXPECT_EQ(rows, PairRamp{}.cycles());
}

TEST_F(EvaluatePair, RefusesWhatItsTraceCannotServe) {
  const std::string two = pair(PairRamp{}.trace());
  run({"--method", "tangent", "--trace", two}, 2);
  EXPECT_THAT(error_, HasSubstr("stiffness, which not all samples of two tools have"));
  run({"--method", "direct", "--trace", two}, 2);
  EXPECT_THAT(error_, HasSubstr("a trace holds no object"));
  run({"--method", "kriging-9d", "--trace", two}, 2);
  EXPECT_THAT(error_, HasSubstr("known methods: auto-6d"));
  run({"--method", "kriging-6d", "--trace", written(Ramp{}.trace())}, 2);
  EXPECT_THAT(error_, HasSubstr("'kriging-6d' is for two tools, and "));
  EXPECT_THAT(error_, HasSubstr("columns p1x_m to f2z_N"));
  const std::string bad = folder_ + "/bad.csv";
  std::ofstream(bad) << "kind,t_s,delivered_s,p1x_m,p1y_m,p1z_m,f1x_N,f1y_N,f1z_N\n";
  run({"--method", "kriging-6d", "--trace", bad}, 1);
  EXPECT_THAT(error_, HasSubstr("bad.csv, line 1: column 'p2x_m': is missing from the header"));
}

}  // namespace
}  // namespace forcegrid
