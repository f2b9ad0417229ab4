// SPDX-License-Identifier: Apache-2.0
// Recorded traces beside this project, with the errors that another implementation of the methods
// reached on them.

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "evaluation/judge/judge.h"
#include "evaluation/traces/trace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"

namespace forcegrid::evaluation {
namespace {

const std::string kFolder = FORCEGRID_SOURCE_DIR "/../shared/traces/";

std::vector<std::string> cells_of(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> cells;
  for (std::string cell; std::getline(stream, cell, ',');) {
    cells.push_back(cell);
  }
  return cells;
}

// trace -> method -> error in %
std::map<std::string, std::map<std::string, double>> references() {
  std::ifstream file(kFolder + "reference_error_percent.csv");
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> methods = cells_of(line);
  std::map<std::string, std::map<std::string, double>> table;
  while (std::getline(file, line)) {
    const std::vector<std::string> cells = cells_of(line);
    for (std::size_t i = 1; i < cells.size(); ++i) {
      table[cells[0]][methods.at(i)] = std::stod(cells[i]);
    }
  }
  return table;
}

double error_percent(const std::string& method_text, const Trace& trace) {
  MethodOptions base;
  base.grid.max_W = {0.16, 0.12, 0.12};
  base.grid.cells.setConstant(49);
  const MethodVariant variant = parse_method_variant(method_text, base);
  const auto method = make_force_method(variant.name, variant.options);
  return judge(*method, trace).rms_error_percent_after_1s;
}

class ReferenceTraces : public ::testing::TestWithParam<std::string> {};

TEST_P(ReferenceTraces, GiveTheErrorsOfTheReferenceWithinATenth) {
  const Trace trace = read_trace(kFolder + GetParam() + ".csv.gz");
  const auto reference = references().at(GetParam());
  for (const char* method :
       {"hold", "linear", "broyden", "rls", "tangent", "forcegrid unit=m", "forcegrid unit=mm"}) {
    EXPECT_NEAR(error_percent(method, trace), reference.at(method), 0.1 * reference.at(method))
        << method;
  }
}

// Kriging may be better, and no more than a tenth worse.
TEST_P(ReferenceTraces, AreFollowedByKrigingAsWellAsByTheReference) {
  const Trace trace = read_trace(kFolder + GetParam() + ".csv.gz");
  const auto reference = references().at(GetParam());
  for (const char* method : {"kriging nug=1e-5", "kriging nug=1e-6", "kriging-bank"}) {
    EXPECT_LT(error_percent(method, trace), 1.1 * reference.at(method)) << method;
  }
  JudgeOptions without_stiffness;
  without_stiffness.stiffness_to_method = false;
  const auto bank = make_force_method("kriging-bank", {});
  EXPECT_LT(judge(*bank, trace, without_stiffness).rms_error_percent_after_1s,
            1.1 * reference.at("kriging-bank"));
}

INSTANTIATE_TEST_SUITE_P(Recorded, ReferenceTraces,
                         ::testing::Values("chirpN", "chirpT", "liss", "human", "poke",
                                           "human_delay100", "human_noise10mN"),
                         [](const auto& test) { return test.param; });

}  // namespace
}  // namespace forcegrid::evaluation
