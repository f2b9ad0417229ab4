// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/paper_command.h"

#include <cstdio>

#include "cli/charts/chart_support.h"
#include "cli/common/options.h"
#include "cli/common/tools_names.h"
#include "cli/run/run_checks.h"
#include "paper/claims.h"
#include "paper/paper.h"
#include "paper/report.h"

namespace forcegrid::cli {

void add_paper(Command& app, PaperCommandOptions& o, std::function<int()>& action) {
  Command& paper = app.add_subcommand("paper", tools_description("paper"));
  add_chart_choice(paper, o,
                   {.quick = "One motion and fewer trials, within two minutes",
                    .jobs = "Threads that solve",
                    .cached = "force tables and reference forces",
                    .seed = "Of motions and of the observers' errors"});
  paper.callback([&o, &action] { action = [&o] { return paper_command(o); }; });
}

int paper_command(const PaperCommandOptions& asked) {
  ProgressLine line;
  paper::PaperOptions options;
  take_choice(options, asked, line);
  options.plan = paper::plan_of(asked.quick);
  const paper::Results results = resumable([&options] { return paper::run_experiments(options); });
  const auto files = paper::write_report(results, options);
  line.clear();
  for (const paper::Claim& claim : paper::claims_of(results)) {
    std::printf("%-15s %s: %s (the paper: %s)\n", paper::to_string(claim.outcome),
                claim.topic.c_str(), claim.here.c_str(), claim.paper.c_str());
  }
  for (const std::string& sentence : results.comparison.which_to_take) {
    std::printf("%s\n", sentence.c_str());
  }
  std::printf("%s; open %s\n", time_text(results.elapsed_s).c_str(), files.back().c_str());
  return 0;
}

}  // namespace forcegrid::cli
