// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_summary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <type_traits>
#include <vector>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Results of the method study with the paper's grid on such a block: RMS error after 1 s in %.
struct Reference {
  const char* trajectory;
  double unit_mm_percent;
  double unit_m_percent;
};
constexpr std::array<Reference, 6> kReferences{{{"chirp", 10.8, 47.0},
                                                {"chirp_oblique", 7.1, 25.0},
                                                {"lissajous", 23.0, 44.0},
                                                {"random", 28.7, 46.0},
                                                {"poke", 14.6, 53.0},
                                                {"hold", 4.2, 6.8}}};

bool is_static(const std::string& motion) {
  return motion != kVisits && Trajectory(motion).is_static();
}

const ChartRow* find_row(const Chart& chart, const std::string& scene,
                         const std::string& trajectory, const std::string& condition,
                         const std::string& method) {
  const auto found = std::find_if(chart.rows.begin(), chart.rows.end(), [&](const ChartRow& row) {
    return row.scene == scene && row.trajectory == trajectory && row.condition == condition &&
           row.method == method;
  });
  return found == chart.rows.end() ? nullptr : &*found;
}

// The largest of some values and its place.
struct Worst {
  double value = kUnknown;
  std::string where;
  void take(double candidate, const std::string& at) {
    if (std::isnan(value) || candidate > value) {
      value = candidate;
      where = at;
    }
  }
};

class Numbers {
 public:
  Numbers(const Chart& chart, const std::string& scene, const std::string& method)
      : chart_(chart), scene_(scene), method_(method) {}

  const ChartRow* row(const std::string& trajectory, const std::string& condition,
                      const std::string& method) const {
    return find_row(chart_, scene_, trajectory, condition, method);
  }

  // The worst of a figure over the static trajectories.
  Worst over_static(const std::string& condition, double Verdict::*figure) const {
    Worst worst;
    for (const std::string& trajectory : trajectory_names()) {
      const ChartRow* found = row(trajectory, condition, method_);
      if (found != nullptr && is_static(trajectory)) {
        worst.take(found->verdict.*figure, trajectory);
      }
    }
    return worst;
  }

  // The largest error of the windows after the tool has returned to a place.
  Worst return_of(const std::string& method) const {
    Worst worst;
    if (const ChartRow* found = row("exploration", "ideal", method)) {
      worst.take(found->returns.first_33ms_percent, "first 33 ms");
      worst.take(found->returns.to_100ms_percent, "33 to 100 ms");
      worst.take(found->returns.to_500ms_percent, "0.1 to 0.5 s");
      worst.take(found->returns.to_1s_percent, "0.5 to 1 s");
    }
    return worst;
  }

  double geometric_mean(const std::string& condition) const {
    double sum = 0.0;
    int count = 0;
    for (const std::string& trajectory : trajectory_names()) {
      const ChartRow* found = row(trajectory, condition, method_);
      if (found != nullptr && is_static(trajectory)) {
        sum += std::log(found->verdict.rms_error_percent_after_1s);
        ++count;
      }
    }
    return count > 0 ? std::exp(sum / count) : kUnknown;
  }

  Worst of(const std::string& trajectory, const std::string& condition,
           double Verdict::*figure) const {
    Worst worst;
    if (const ChartRow* found = row(trajectory, condition, method_)) {
      worst.take(found->verdict.*figure, trajectory);
    }
    return worst;
  }

  // The largest ratio of the error with stiffness on the link to that without.
  Worst harm_of_stiffness() const {
    Worst worst;
    for (const std::string& trajectory : trajectory_names()) {
      const ChartRow* without = row(trajectory, "ideal", method_);
      const ChartRow* with = row(trajectory, "stiffness", method_);
      if (without != nullptr && with != nullptr && is_static(trajectory)) {
        worst.take(
            with->verdict.rms_error_percent_after_1s / without->verdict.rms_error_percent_after_1s,
            trajectory + ", after 1 s");
        worst.take(
            with->verdict.rms_error_percent_first_1s / without->verdict.rms_error_percent_first_1s,
            trajectory + ", first second");
      }
    }
    return worst;
  }

  // The worst of a figure over the motions on the scene with an addition, e.g. wall_flat.
  Worst on_hard_scenes(const std::vector<std::string>& additions, double (*figure)(const ChartRow&),
                       const std::string& motion = {}) const {
    Worst worst;
    for (const ChartRow& each : chart_.rows) {
      for (const std::string& addition : additions) {
        const double value = figure(each);
        if (each.scene == scene_ + '+' + addition && each.condition == "ideal" &&
            each.method == method_ && (motion.empty() || each.trajectory == motion) &&
            std::isfinite(value)) {
          worst.take(value, addition + ", " + each.trajectory);
        }
      }
    }
    return worst;
  }

  Worst of_visits(const std::string& condition, double (*figure)(const ChartRow&)) const {
    Worst worst;
    if (const ChartRow* found = row(kVisits, condition, method_)) {
      worst.take(figure(*found), "visits");
    }
    return worst;
  }

  // The largest ratio of the error to what no method can be below, where that is large enough to
  // matter. With requests a method may be better.
  Worst over_blind_limit() const {
    constexpr double kMatters_percent = 0.5;
    Worst worst;
    for (const ChartRow& each : chart_.rows) {
      if (each.method != method_ || each.condition.starts_with("requests") ||
          (each.scene != scene_ && !each.scene.starts_with(scene_ + '+'))) {
        continue;
      }
      const std::string where = each.scene + ", " + each.trajectory + ", " + each.condition;
      const auto take = [&](double error_percent, double limit_percent, const char* when) {
        if (limit_percent > kMatters_percent) {
          worst.take(error_percent / limit_percent, where + when);
        }
      };
      take(each.verdict.rms_error_percent_after_1s, each.blind_limit.after_1s_percent, "");
      take(each.verdict.rms_error_percent_first_1s, each.blind_limit.first_1s_percent,
           ", first second");
    }
    return worst;
  }

  // The largest ratio, or difference, of a method's error to another one's.
  Worst against(const std::string& method, const std::string& other, bool difference) const {
    Worst worst;
    for (const std::string& trajectory : trajectory_names()) {
      const ChartRow* one = row(trajectory, "ideal", method);
      const ChartRow* two = row(trajectory, "ideal", other);
      if (one != nullptr && two != nullptr && is_static(trajectory)) {
        const double a = one->verdict.rms_error_percent_after_1s;
        const double b = two->verdict.rms_error_percent_after_1s;
        worst.take(difference ? a - b : a / b, trajectory);
      }
    }
    return worst;
  }

  // The cost of a method over the scene's rows without requests: the median row, so that a
  // disturbance of the machine has no effect.
  template <typename Figure>
  Worst cost(const std::string& method, const Figure& figure) const {
    std::vector<double> values;
    for (const ChartRow& each : chart_.rows) {
      double value = 0.0;
      if constexpr (std::is_member_object_pointer_v<Figure>) {
        value = each.verdict.*figure;
      } else {
        value = figure(each);
      }
      if (each.scene == scene_ && each.method == method && each.condition == "ideal" &&
          std::isfinite(value)) {
        values.push_back(value);
      }
    }
    Worst worst;
    if (!values.empty()) {
      std::nth_element(values.begin(), values.begin() + static_cast<long>(values.size() / 2),
                       values.end());
      worst.take(values[values.size() / 2], "median over the trajectories");
    }
    return worst;
  }

  Worst reproduction(const std::string& method, double Reference::*figure) const {
    Worst worst;
    for (const Reference& reference : kReferences) {
      if (const ChartRow* found = row(reference.trajectory, "ideal", method)) {
        worst.take(
            100.0 * std::abs(found->verdict.rms_error_percent_after_1s / (reference.*figure) - 1.0),
            reference.trajectory);
      }
    }
    return worst;
  }

  void add(const std::string& name, double goal, const Worst& worst, const std::string& unit) {
    list.push_back({name, scene_, goal, worst.value, unit, worst.where});
  }

  std::vector<ChartNumber> list;

 private:
  const Chart& chart_;
  std::string scene_;
  std::string method_;
};

// The simplest condition that a method can use: the first of these that it has rows for.
constexpr std::array<const char*, 3> kPointConditions{"ideal", "stiffness", "requests120"};

double after_1s(const ChartRow& row) { return row.verdict.rms_error_percent_after_1s; }

// Second objects, objects that remember or change, simulators that do not converge, and the first
// instants of contacts.
void hard_numbers(Numbers& n) {
  const std::vector<std::string> single{"wall_flat", "wall_tilted", "wall_stiffening", "wall_soft"};
  n.add("wall: whole run", 3.0, n.on_hard_scenes(single, after_1s), "%");
  n.add("wall: from 0.2 s after the first touch", 0.3,
        n.on_hard_scenes(single, [](const ChartRow& row) { return row.after_touch_percent; }), "%");
  n.add("two walls", 3.0, n.on_hard_scenes({"wall_two"}, after_1s), "%");
  n.add("curved wall on lissajous", 3.0, n.on_hard_scenes({"wall_curved"}, after_1s, "lissajous"),
        "%");
  n.add("viscous, 3 Ns/m", 0.6, n.on_hard_scenes({"viscous"}, after_1s), "%");
  n.add("quasi-linear relaxation", 1.8, n.on_hard_scenes({"relaxing"}, after_1s), "%");
  n.add("cut", 2.8, n.on_hard_scenes({"cut"}, after_1s), "%");
  n.add("slide", 1.5, n.on_hard_scenes({"sliding"}, after_1s), "%");
  n.add("unconverged simulator", 4.0, n.on_hard_scenes({"unconverged"}, after_1s), "%");
  n.add("first 67 ms at a known place", 0.3,
        n.of_visits("ideal",
                    [](const ChartRow& row) { return row.visits.returns.first_67ms_percent; }),
        "%");
  n.add("error / what no method can be below, where that is over 0.5 %", 1.15, n.over_blind_limit(),
        "");
  const auto unknown = [](const ChartRow& row) {
    return row.visits.unknown_places.first_67ms_percent;
  };
  n.add("first 67 ms at an unknown place, 120 requests/s", 0.5, n.of_visits("requests120", unknown),
        "%");
  n.add("first 67 ms at an unknown place", 2.5, n.of_visits("ideal", unknown), "%");
}

}  // namespace

std::vector<ChartPoint> points_of(const Chart& chart, const std::string& scene) {
  struct Sum {
    double log_error = 0.0;
    double cycle_ns = 0.0;
    double count = 0.0;
  };
  std::map<std::pair<std::string, std::string>, Sum> sums;  // by method and condition
  std::vector<std::string> methods;
  for (const ChartRow& row : chart.rows) {
    if (row.scene == scene && is_static(row.trajectory)) {
      Sum& sum = sums[{row.method, row.condition}];
      sum.log_error += std::log(row.verdict.rms_error_percent_after_1s);
      sum.cycle_ns += row.verdict.cycle_ns;
      sum.count += 1.0;
      if (std::find(methods.begin(), methods.end(), row.method) == methods.end()) {
        methods.push_back(row.method);
      }
    }
  }
  std::vector<ChartPoint> points;
  for (const std::string& method : methods) {
    for (const char* condition : kPointConditions) {
      const auto found = sums.find({method, condition});
      if (found != sums.end()) {
        const Sum& sum = found->second;
        points.push_back(
            {method, condition, std::exp(sum.log_error / sum.count), sum.cycle_ns / sum.count});
        break;
      }
    }
  }
  std::sort(points.begin(), points.end(),
            [](const ChartPoint& a, const ChartPoint& b) { return a.cycle_ns < b.cycle_ns; });
  std::vector<double> cost;
  std::vector<double> error;
  for (const ChartPoint& point : points) {
    cost.push_back(point.cycle_ns);
    error.push_back(point.error_percent);
  }
  const std::vector<bool> front = pareto_front(cost, error);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].on_front = front[i];
  }
  return points;
}

std::vector<ChartNumber> numbers_of(const Chart& chart, const std::string& default_method) {
  std::string hardest;
  for (const ChartScene& scene : chart_scenes()) {
    if (std::any_of(chart.rows.begin(), chart.rows.end(),
                    [&scene](const ChartRow& row) { return row.scene == scene.name; })) {
      hardest = scene.name;
    }
  }
  constexpr auto kAfter = &Verdict::rms_error_percent_after_1s;
  constexpr auto kFirst = &Verdict::rms_error_percent_first_1s;
  Numbers n(chart, hardest, default_method);
  n.add("RMS error on each static trajectory", 0.3, n.over_static("ideal", kAfter), "%");
  n.add("its geometric mean over them", 0.15, {n.geometric_mean("ideal"), "all of them"}, "%");
  n.add("worst instant after 1 s", 3.0,
        n.over_static("ideal", &Verdict::max_error_percent_after_1s), "%");
  n.add("first second of poke, force only", 12.0, n.of("poke", "ideal", kFirst), "%");
  n.add("first second of poke, with stiffness", 4.0, n.of("poke", "stiffness", kFirst), "%");
  n.add("first second of poke, 120 requests/s", 3.0, n.of("poke", "requests120", kFirst), "%");
  n.add("error with stiffness / without", 1.0, n.harm_of_stiffness(), "");
  n.add("+100 ms delay", 1.0, n.over_static("delay100", kAfter), "%");
  n.add("20 ms + 20 ms jitter + 20 % loss", 0.4, n.over_static("lossy", kAfter), "%");
  n.add("simulator at 10 Hz", 1.0, n.over_static("rate10", kAfter), "%");
  n.add("10 mN noise", 0.8, n.over_static("noise10", kAfter), "%");
  n.add("re-grab elsewhere, same stiffness", 0.3, n.of("regrab", "ideal", kAfter), "%");
  n.add("re-grab elsewhere, +-30 % stiffness", 4.0, n.of("regrab_varied", "ideal", kAfter), "%");
  Worst work;
  if (const ChartRow* circle = n.row("circle", "ideal", default_method)) {
    work.take(std::abs(circle->worst_loop_work_percent), "the worst turn");
  }
  n.add("work around a closed loop, of the stored energy", 1.0, work, "%");
  hard_numbers(n);
  // 25 and 8 ns if the bare read takes 4 ns.
  const auto of_bare_read = [&chart](Worst cost) {
    cost.value /= chart.bare_trilinear_read_ns;
    return cost;
  };
  for (const std::string& method :
       {default_method, std::string("kriging-store"), std::string("forcegrid-kriging")}) {
    n.add("return after two minutes, " + method, 0.1, n.return_of(method), "%");
  }
  n.add("kriging-filled grid's error less its own kriging's", 0.02,
        n.against("forcegrid-kriging", "kriging-store", true), "%");
  n.add("error / that of kriging", 1.0, n.against(default_method, "kriging", false), "");
  Worst memory = n.cost(default_method, [](const ChartRow& each) {
    return 1e-6 * static_cast<double>(each.verdict.memory_bytes);
  });
  n.add("memory", 4.0, memory, "MB");
  n.add("query, forcegrid-kriging / bare trilinear read", 6.25,
        of_bare_read(n.cost("forcegrid-kriging", &Verdict::query_ns_median)), "");
  n.add("taking in a sample, kriging-store", 100.0,
        n.cost("kriging-store", &Verdict::sample_us_median), "us");
  n.add("query, kriging / bare trilinear read", 6.25,
        of_bare_read(n.cost("kriging", &Verdict::query_ns_median)), "");
  n.add("query, forcegrid / bare trilinear read", 2.0,
        of_bare_read(n.cost("forcegrid", &Verdict::query_ns_median)), "");
  n.add("taking in a sample, kriging", 30.0, n.cost("kriging", &Verdict::sample_us_median), "us");
  n.add("taking in a sample, kriging-bank", 400.0,
        n.cost("kriging-bank", &Verdict::sample_us_median), "us");
  n.add("paper's grid in mm, deviation from the study", 20.0,
        n.reproduction("forcegrid", &Reference::unit_mm_percent), "%");
  n.add("paper's grid in m, deviation from the study", 20.0,
        n.reproduction("forcegrid unit=m", &Reference::unit_m_percent), "%");
  return n.list;
}

}  // namespace forcegrid::evaluation
