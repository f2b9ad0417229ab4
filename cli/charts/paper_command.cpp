#include "cli/charts/paper_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>

#include "cli/charts/chart_support.h"
#include "cli/run/run_checks.h"
#include "paper/claims.h"
#include "paper/paper.h"
#include "paper/report.h"

namespace forcegrid::cli {

void add_paper(CLI::App& app, PaperCommandOptions& o, std::function<int()>& action) {
  CLI::App& paper = *app.add_subcommand(
      "paper", "Run the forcegrid paper's experiments, and set the results beside its claims");
  paper.add_option("--out", o.out, "Folder for tables, pictures and the page")->required();
  paper.add_flag("--quick", o.quick, "One motion and fewer trials, within two minutes");
  paper.add_option("--jobs", o.jobs, "Threads that solve; 0 is one a processor")
      ->check(CLI::Range(0, 1024))
      ->type_name("UINT threads")
      ->capture_default_str();
  paper.add_option("--cache", o.cache,
                   "Folder of force tables and reference forces (default forcegrid in the user's "
                   "cache folder)");
  paper.add_option("--seed", o.seed, "Of motions and of the observers' errors")
      ->capture_default_str();
  paper.callback([&o, &action] { action = [&o] { return paper_command(o); }; });
}

int paper_command(const PaperCommandOptions& asked) {
  prepare_folder(asked.out);  // found out before minutes of work are lost
  ProgressLine line;
  paper::PaperOptions options;
  options.out = asked.out;
  options.cache = cache_folder(asked.cache);
  options.plan = paper::plan_of(asked.quick);
  options.jobs = asked.jobs;
  options.seed = asked.seed;
  options.cancel = &StopRequest::stop();
  options.say = line.say_function();
  options.progress = line.show_function();
  try {
    const paper::Results results = paper::run_experiments(options);
    const auto files = paper::write_report(results, options);
    line.clear();
    for (const paper::Claim& claim : paper::claims_of(results)) {
      std::printf("%-15s %s: %s (the paper: %s)\n", paper::to_string(claim.outcome),
                  claim.topic.c_str(), claim.here.c_str(), claim.paper.c_str());
    }
    std::printf("%s; look at %s\n", time_text(results.elapsed_s).c_str(), files.back().c_str());
  } catch (...) {
    line.clear();
    throw;
  }
  return 0;
}

}  // namespace forcegrid::cli
