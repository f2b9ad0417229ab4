// SPDX-License-Identifier: Apache-2.0
#include "tools/dashboard_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>

#include "driver/force_limiter.h"
#include "rt/vectors.h"
#include "servo_loop/fault.h"
#include "tools/latency_histogram.h"

namespace forcegrid::tools {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::array<double, 7> kBinEdges_us = {20, 50, 100, 200, 500, 1000, 2000};
constexpr int kTimingBar = 50;
constexpr double kFullBar_N = 10.0;

[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...) {
  char line[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return line;
}

std::string times(const char* name, const rt::Percentiles& values, const char* unit, double scale) {
  return text("%-11s p50 %8.2f   p99 %8.2f   p99.9 %8.2f   worst %9.2f %s", name,
              scale * values.at(0.5), scale * values.at(0.99), scale * values.at(0.999),
              scale * values.max(), unit);
}

std::string limits(std::uint8_t acted) {
  std::string words;
  const std::array<std::pair<int, const char*>, 6> names = {
      {{driver::kLimitNotFinite, "not finite"},
       {driver::kLimitForce, "force"},
       {driver::kLimitSlew, "slew"},
       {driver::kLimitTorque, "torque"},
       {driver::kLimitCurrent, "current"},
       {driver::kLimitWarm, "warm"}}};
  for (const auto& [bit, name] : names) {
    if ((acted & bit) != 0) {
      words += (words.empty() ? "" : ", ") + std::string(name);
    }
  }
  return words.empty() ? "none" : words;
}

double norm(const servo::Triple& t) { return rt::to_vector(t).norm(); }

}  // namespace

DashboardPicture::DashboardPicture(DashboardTitle title)
    : title_(std::move(title)), wakeup_bins_(kBinEdges_us.size() + 1) {}

void DashboardPicture::note(const std::string& words) {
  note_ = words;
  std::replace_if(
      note_.begin(), note_.end(), [](char c) { return c < ' ' || c > '~'; }, ' ');
}

void DashboardPicture::add(const servo::CycleRecord& cycle) {
  if (cycles_ == 0) {
    first_ns_ = second_begun_ns_ = cycle.time_ns;
  } else {
    period_us_.add(cycle.period_us);
    const Eigen::Vector3d moved =
        rt::to_vector(cycle.position_W_m) - rt::to_vector(newest_.position_W_m);
    work_J_ += rt::to_vector(newest_.commanded_force_D_N).dot(moved);
  }
  ++cycles_;
  missed_ += cycle.missed_deadlines;
  wakeup_us_.add(cycle.wakeup_us);
  compute_us_.add(cycle.compute_us);
  report_age_us_.add(cycle.report_age_us);
  if (cycle.sample_age_ms >= 0.0) {
    sample_age_ms_.add(cycle.sample_age_ms);
  }
  const auto bin = std::lower_bound(kBinEdges_us.begin(), kBinEdges_us.end(), cycle.wakeup_us);
  ++wakeup_bins_[static_cast<std::size_t>(bin - kBinEdges_us.begin())];
  force_max_N_ = std::max(force_max_N_, norm(cycle.commanded_force_D_N));
  add_second(cycle);
  newest_ = cycle;
}

void DashboardPicture::add_second(const servo::CycleRecord& cycle) {
  ++second_cycles_;
  const std::int64_t since_ns = cycle.time_ns - second_begun_ns_;
  if (since_ns >= kSecond_ns) {
    rate_Hz_ = 1e9 * static_cast<double>(second_cycles_ - 1) / static_cast<double>(since_ns);
    second_begun_ns_ = cycle.time_ns;
    second_cycles_ = 1;
  }
}

std::vector<std::string> DashboardPicture::lines(int columns, int rows) const {
  const servo::CycleRecord& c = newest_;
  const double elapsed_s = 1e-9 * static_cast<double>(c.time_ns - first_ns_);
  const std::string candidate = c.rendered_candidate < title_.candidates.size()
                                    ? " (" + title_.candidates[c.rendered_candidate] + ")"
                                    : "";
  const double asked_N = norm(c.method_force_W_N[0]);
  const double sent_N = norm(c.commanded_force_D_N);
  std::vector<std::string> all{
      "forcegrid  " + title_.device,
      text("%-52s %18.1f s", ("scene " + title_.scene + "  method " + title_.method).c_str(),
           elapsed_s),
      "",
      text("rate        %7.1f of %.0f cycles/s   missed %llu of %llu deadlines", rate_Hz_,
           title_.rate_Hz, static_cast<unsigned long long>(missed_),
           static_cast<unsigned long long>(cycles_ + missed_)),
      times("period", period_us_, "ms", 1e-3),
      times("compute", compute_us_, "us", 1.0),
      times("report age", report_age_us_, "ms", 1e-3),
      times("sample age", sample_age_ms_, "ms", 1.0),
      "",
      text("tool        x %+8.2f  y %+8.2f  z %+8.2f mm     speed %6.3f m/s",
           1e3 * c.position_W_m[0], 1e3 * c.position_W_m[1], 1e3 * c.position_W_m[2],
           norm(c.velocity_W_m_per_s)),
      text("asked %6.2f N %s", asked_N, text_bar(asked_N / kFullBar_N, kTimingBar).c_str()),
      text("sent  %6.2f N %s", sent_N, text_bar(sent_N / kFullBar_N, kTimingBar).c_str()),
      text("contact     %-4s gain %4.2f  largest force %5.2f N  current %+5.2f %+5.2f %+5.2f A",
           c.in_contact ? "yes" : "no", c.gain, force_max_N_, c.current_A[0], c.current_A[1],
           c.current_A[2]),
      text("method      %s%s, force from: %s", to_string(c.method_status[0]), candidate.c_str(),
           to_string(c.rung)),
      text("energy      to the hand %+8.2f mJ in this contact, %+8.2f mJ in all",
           1e3 * c.energy_to_hand_J, 1e3 * work_J_),
      text("limits      %-24s fault %s", limits(c.limits_acted).c_str(), servo::name_of(c.fault)),
      ""};
  // The histogram takes the remaining lines but the last.
  all[all.size() - 1] =
      text("wake-up     late by at most ... us: share of cycles; worst %.0f us", wakeup_us_.max());
  std::vector<std::string> histogram;
  for (std::size_t i = 0; i < wakeup_bins_.size(); ++i) {
    const double share =
        cycles_ == 0 ? 0.0 : static_cast<double>(wakeup_bins_[i]) / static_cast<double>(cycles_);
    const std::string edge = i < kBinEdges_us.size() ? text("%6.0f", kBinEdges_us[i]) : "  more";
    histogram.push_back(
        text("%s %7.3f %% %s", edge.c_str(), 100.0 * share, text_bar(share, kTimingBar).c_str()));
  }
  // If rows are few, the rarest small bins are left out; two bins per line would be unreadable.
  const auto room = static_cast<std::size_t>(std::max(rows - 1, 0));
  for (std::size_t i = 0; i < histogram.size() && all.size() < room; ++i) {
    const std::size_t left = room - all.size();
    const std::size_t bins_left = histogram.size() - i;
    if (bins_left > left && i < bins_left - left) {
      continue;
    }
    all.push_back(histogram[i]);
  }
  all.resize(std::min(all.size(), room));
  all.push_back(note_.empty() ? "Ctrl-C ends it" : note_);
  for (std::string& line : all) {
    line.resize(std::min(line.size(), static_cast<std::size_t>(std::max(columns, 1))));
  }
  return all;
}

}  // namespace forcegrid::tools
