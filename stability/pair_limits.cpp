// SPDX-License-Identifier: Apache-2.0
#include "stability/pair_limits.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "evaluation/charts/page_text.h"
#include "evaluation/files/text_file.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/pair_methods.h"
#include "rt/checkpoint.h"
#include "rt/parallel_jobs.h"

namespace forcegrid::stability {
namespace {

namespace fs = std::filesystem;

const PairNetwork& network_of(const std::string& name) {
  const auto& all = pair_networks();
  return *std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.name == name; });
}

PairMethodMaker maker_of(const std::string& method) {
  if (method == kExactPair) {
    return [] { return nullptr; };
  }
  MethodOptions base;
  base.grid = evaluation::default_trace_workspace();  // holds both hands' workspaces
  const MethodVariant variant = parse_pair_variant(method, base);
  return [variant] { return make_pair_force_method(variant.name, variant.options); };
}

PairLoopSetup setup_of(const PairLimitCell& cell, const PairLimitOptions& options,
                       const PairObjectMaker& object) {
  const PairNetwork& network = network_of(cell.network);
  PairLoopSetup setup;
  setup.object = object;
  setup.stiffness = options.stiffness;
  setup.hand = hand_of(cell.hand);
  setup.servo_rate_Hz = cell.servo_rate_Hz;
  setup.timing = device_timing("ideal");
  setup.together = cell.together;
  setup.delay_s = network.delay_s;
  setup.other_age_s = network.other_age_s;
  if (network.a_cycle_apart && cell.method != kExactPair) {
    setup.other_age_s = {0.0, 1.0 / cell.servo_rate_Hz};
    setup.moved_on = true;
  }
  return setup;
}

std::vector<PairLimitCell> cells_of(const PairLimitOptions& options) {
  std::vector<std::string> methods{kExactPair};
  methods.insert(methods.end(), options.methods.begin(), options.methods.end());
  std::vector<PairLimitCell> cells;
  const auto add = [&](PairLimitCell loop, const std::string& object) {
    loop.object = object;
    for (const std::string& method : methods) {
      cells.push_back(loop);
      cells.back().method = method;
    }
  };
  for (const std::string& object : options.objects) {
    for (const char* const hand : {"light", "firm"}) {
      for (const double rate_Hz : {500.0, 1000.0}) {
        if (options.quick && (hand != std::string("light") || rate_Hz > 500.0)) {
          continue;
        }
        add({.hand = hand, .servo_rate_Hz = rate_Hz, .together = false}, object);
        for (const PairNetwork& network : pair_networks()) {
          add({.hand = hand, .servo_rate_Hz = rate_Hz, .network = network.name}, object);
        }
      }
    }
  }
  return cells;
}

// Of the cell whose search is this one's as well: exact rendering knows no answers, only ages.
std::size_t searched_as(const std::vector<PairLimitCell>& cells, std::size_t number) {
  const PairLimitCell& cell = cells[number];
  const auto no_age = [](const PairLimitCell& c) {
    return network_of(c.network).other_age_s == std::array{0.0, 0.0};
  };
  if (cell.method != kExactPair || !no_age(cell)) {
    return number;
  }
  const auto first = std::find_if(cells.begin(), cells.end(), [&](const PairLimitCell& c) {
    return c.method == kExactPair && no_age(c) && c.object == cell.object && c.hand == cell.hand &&
           c.servo_rate_Hz == cell.servo_rate_Hz && c.together == cell.together;
  });
  return static_cast<std::size_t>(first - cells.begin());
}

// A run of a solved object takes seconds.
double first_N_per_m(const std::string& object) {
  return object == kSprings ? StiffnessScan::kLeast_N_per_m : 64.0 * StiffnessScan::kLeast_N_per_m;
}

PairLimitRow searched(const PairLimitCell& cell, const PairLimitOptions& options,
                      const PairObjectMaker& object, rt::Job& job) {
  PairLoopSetup setup = setup_of(cell, options, object);
  setup.stopping = [&job] { return job.stopping(); };
  setup.judged = false;
  const PairMethodMaker maker = maker_of(cell.method);
  PairLimitRow row{cell, {}, 0.0, std::nan("")};
  row.limit = find_limit(
      [&](double stiffness_N_per_m) {
        return job.stopping() ? Behaviour::kDivergence
                              : run_pair_loop(setup, stiffness_N_per_m, maker).behaviour;
      },
      first_N_per_m(cell.object));
  setup.judged = true;
  const PairLoopResult at = run_pair_loop(setup, kErrorAt_N_per_m, maker);
  if (at.behaviour == Behaviour::kStable) {
    row.force_error_percent = at.force_error_percent;
  }
  return row;
}

bool same_loop(const PairLimitCell& a, const PairLimitCell& b) {
  return a.object == b.object && a.hand == b.hand && a.servo_rate_Hz == b.servo_rate_Hz &&
         a.together == b.together && a.network == b.network;
}

double scanned_N_per_m(const StiffnessLimit& limit) {
  return limit.beyond_scan ? StiffnessScan::kMost_N_per_m : limit.largest_stable_N_per_m;
}

void add_ratios(std::vector<PairLimitRow>& rows) {
  for (PairLimitRow& row : rows) {
    const auto exact = std::find_if(rows.begin(), rows.end(), [&](const PairLimitRow& other) {
      return other.cell.method == kExactPair && same_loop(other.cell, row.cell);
    });
    row.relative_to_exact = scanned_N_per_m(row.limit) / scanned_N_per_m(exact->limit);
  }
}

std::string limit_text(const PairLimitRow& row) {
  std::string text = row.limit.beyond_scan ? "above " : "";
  text += evaluation::readable(scanned_N_per_m(row.limit));
  text += " (" + evaluation::readable(row.relative_to_exact) + ")";
  return text;
}

void write_table(const fs::path& file, const std::vector<PairLimitRow>& rows) {
  evaluation::TextWriter out(file.string());
  out.write(
      "method,servo_rate_Hz,together,largest_stable_N_per_m,beyond_scan,relative_to_exact,"
      "force_error_percent_at_200_N_per_m,hand,network,failure,object\n");
  for (const PairLimitRow& row : rows) {
    std::string line = row.cell.method;
    std::replace(line.begin(), line.end(), ',', ' ');
    for (const double figure :
         {row.cell.servo_rate_Hz, row.cell.together ? 1.0 : 0.0, scanned_N_per_m(row.limit),
          row.limit.beyond_scan ? 1.0 : 0.0, row.relative_to_exact, row.force_error_percent}) {
      line += ',';
      line += evaluation::number(figure);
    }
    for (const std::string& word : {row.cell.hand, row.cell.network,
                                    std::string(to_string(row.limit.failure)), row.cell.object}) {
      line += ',';
      line += word;
    }
    out.write(line + "\n");
  }
  out.finish();
}

void write_page(const fs::path& file, const std::vector<PairLimitRow>& rows) {
  std::string text =
      "# Two hands on one object: up to which stiffness?\n\nLargest stable stiffness [N/m], and in "
      "brackets relative to exact rendering in the same loop.\n\n| object | hand | servo | tools | "
      "network "
      "|";
  std::string rule = "|---|---|---|---|---|";
  std::size_t methods = 1;  // of a loop; the first one has exact rendering at least
  while (methods < rows.size() && same_loop(rows[methods].cell, rows.front().cell)) {
    ++methods;
  }
  for (std::size_t i = 0; i < methods; ++i) {
    text += " `" + rows[i].cell.method + "` |";
    rule += "---|";
  }
  text += "\n" + rule + "\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const PairLimitCell& cell = rows[i].cell;
    if (i % methods == 0) {
      text += "| " + cell.object + " | " + cell.hand + " | " +
              evaluation::readable(cell.servo_rate_Hz) + " Hz | " +
              (cell.together ? "both" : "one") + " | " + cell.network + " |";
    }
    text += ' ';
    text += limit_text(rows[i]);
    text += i % methods + 1 == methods ? " |\n" : " |";
  }
  evaluation::write_file(file, text);
}

}  // namespace

const std::vector<PairNetwork>& pair_networks() {
  static const std::vector<PairNetwork> all{
      {.name = "local", .description = "both in one process, each place known at once"},
      {.name = "cycles",
       .description = "in one process, the two ages of places together a cycle",
       .a_cycle_apart = true},
      {.name = "late",
       .description = "the right side's answers come 100 ms later",
       .delay_s = {0.0, 0.1}},
      {.name = "apart",
       .description = "that, and each knows the other's position of 50 ms ago",
       .delay_s = {0.0, 0.1},
       .other_age_s = {0.05, 0.05}}};
  return all;
}

const std::vector<std::string>& default_pair_limit_methods() {
  static const std::vector<std::string> all{"hold",         "rls",        "kriging",
                                            "forcegrid-6d", "kriging-6d", "auto-6d"};
  return all;
}

std::vector<PairLimitRow> pair_limits(const PairLimitOptions& options) {
  for (const std::string& method : options.methods) {
    maker_of(method)();  // refuses before anything is searched
  }
  const std::vector<PairLimitCell> cells = cells_of(options);
  std::map<std::string, PairObjectMaker> objects;
  for (const std::string& name : options.objects) {
    objects[name] = pair_object_of(name);
    objects[name](kErrorAt_N_per_m);  // refuses one that the tools do not hold
  }
  std::vector<PairLimitRow> rows(cells.size());
  rt::JobOptions jobs{.threads = options.jobs};
  jobs.progress = options.progress;
  jobs.cancel = options.cancel;
  const bool finished = rt::run_jobs(cells.size(), jobs, [&](rt::Job& job) {
    if (searched_as(cells, job.number()) == job.number()) {
      const PairLimitCell& cell = cells[job.number()];
      rows[job.number()] = searched(cell, options, objects.at(cell.object), job);
    }
    return !job.stopping();
  });
  if (!finished) {
    throw rt::Interrupted();  // not evaluation::Stopped: no row is kept
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    rows[i] = rows[searched_as(cells, i)];
    rows[i].cell = cells[i];
  }
  add_ratios(rows);
  return rows;
}

double least_relative_limit(const std::vector<PairLimitRow>& rows, const std::string& object,
                            const std::string& method) {
  double least = std::nan("");
  for (const PairLimitRow& row : rows) {
    if (row.cell.object == object && row.cell.method == method &&
        !(row.relative_to_exact >= least)) {
      least = row.relative_to_exact;
    }
  }
  return least;
}

std::vector<fs::path> write_pair_limits(const fs::path& folder,
                                        const std::vector<PairLimitRow>& rows) {
  if (rows.empty()) {
    throw std::invalid_argument("stability of two hands: no row to write");
  }
  const std::vector<fs::path> files{folder / "stability.csv", folder / "stability.md"};
  write_table(files[0], rows);
  write_page(files[1], rows);
  return files;
}

}  // namespace forcegrid::stability
