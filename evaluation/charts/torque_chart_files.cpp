// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

#include "evaluation/charts/torque_chart.h"
#include "evaluation/files/error.h"
#include "evaluation/files/gnuplot.h"
#include "evaluation/files/text_file.h"

namespace forcegrid::evaluation {
namespace {

namespace fs = std::filesystem;

struct WayLook {
  const char* title;
  const char* colour;
};
constexpr std::array<WayLook, kTorqueWays.size()> kLooks = {
    {{"held torque", "#888888"},
     {"lever arm alone", "#d95f02"},
     {"held in the tool's frame", "#7a5195"},
     {"lever arm + stiffness", "#1b6ca8"},
     {"the same + d(torque)/dP", "#1a9641"}}};
constexpr double kShown_s = 1.0;  // the end of the motion

void append_vector(std::string& text, const Eigen::Vector3d& vector) {
  for (int axis = 0; axis < 3; ++axis) {
    text += ',';
    append_number(text, vector[axis]);
  }
}

void write_instants(const fs::path& file, const TorqueRow& row) {
  TextWriter out(file.string());
  std::string head =
      "t_s,x_W_m,y_W_m,z_W_m,turn_w,turn_x,turn_y,turn_z,exact_x_W_Nm,exact_y_W_Nm,"
      "exact_z_W_Nm";
  for (const TorqueWay way : kTorqueWays) {
    for (const char* axis : {"_x", "_y", "_z"}) {
      head += std::string(",") + to_string(way) + axis + "_W_Nm";
    }
  }
  out.write(head + "\n");
  for (const TorqueInstant& instant : row.instants) {
    std::string text;
    append_number(text, instant.time_s);
    append_vector(text, instant.pose.displacement_W);
    const Eigen::Quaterniond& q = instant.pose.turn_W;
    for (const double part : {q.w(), q.x(), q.y(), q.z()}) {
      text += ',';
      append_number(text, part);
    }
    append_vector(text, instant.exact_W_Nm);
    for (const Eigen::Vector3d& rendered_W_Nm : instant.rendered_W_Nm) {
      append_vector(text, rendered_W_Nm);
    }
    out.write(text + "\n");
  }
  out.finish();
}

// The axis of W about which the torque of the motion is largest.
int main_axis(const TorqueRow& row) {
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  for (const TorqueInstant& instant : row.instants) {
    squares += instant.exact_W_Nm.cwiseAbs2();
  }
  Eigen::Index axis = 0;
  squares.maxCoeff(&axis);
  return static_cast<int>(axis);
}

void draw_errors(std::ostringstream& script, const std::vector<TorqueRow>& rows) {
  script << "$errors << EOD\n";
  for (const TorqueRow& row : rows) {
    script << row.motion;
    for (const double percent : row.rms_error_percent) {
      script << ' ' << percent;
    }
    script << '\n';
  }
  script << "EOD\nset style data histogram\nset style histogram clustered gap 1\n"
            "set style fill solid 0.9\nset logscale y\nset ylabel 'RMS torque error / % of RMS'\n"
            "plot ";
  for (std::size_t way = 0; way < kTorqueWays.size(); ++way) {
    script << (way == 0 ? "$errors" : ", $errors") << " using " << way + 2
           << (way == 0 ? ":xtic(1)" : "") << " lc rgb " << quoted(kLooks[way].colour) << " title "
           << quoted(kLooks[way].title);
  }
  script << "\nunset logscale y\n";
}

void draw_second(std::ostringstream& script, const TorqueRow& row) {
  const int axis = main_axis(row);
  const double from_s = row.instants.back().time_s - kShown_s;
  script << "$shown << EOD\n";
  for (const TorqueInstant& instant : row.instants) {
    if (instant.time_s < from_s) {
      continue;
    }
    script << instant.time_s << ' ' << 1e3 * instant.exact_W_Nm[axis];
    for (const Eigen::Vector3d& rendered_W_Nm : instant.rendered_W_Nm) {
      script << ' ' << 1e3 * rendered_W_Nm[axis];
    }
    script << '\n';
  }
  script << "EOD\nset xrange [" << from_s << ':' << row.instants.back().time_s
         << "]\nset xlabel 't / s'\nset ylabel "
         << quoted("torque about " + std::string(1, "xyz"[axis]) + " / mN m, motion " + row.motion)
         << "\nplot $shown using 1:2 with lines lw 4 lc rgb '#bbbbbb' title 'exact'";
  for (std::size_t way = 0; way < kTorqueWays.size(); ++way) {
    script << ", $shown using 1:" << way + 3 << " with lines lw 1.5 lc rgb "
           << quoted(kLooks[way].colour) << " notitle";
  }
  script << '\n';
}

void draw(const fs::path& file, const TorqueChartOptions& options,
          const std::vector<TorqueRow>& rows) {
  std::ostringstream script;
  script << "set terminal svg size 1240,480 background '#ffffff' font 'sans,12'\nset output "
         << quoted(file.string()) << "\nset multiplot layout 1,2 title "
         << quoted("A twisting grasp on " + options.scene + ", rendered from samples at " +
                   std::to_string(static_cast<int>(options.simulator_rate_Hz)) + " Hz")
         << "\nset border 3\nset xtics nomirror\nset ytics nomirror\n"
            "set grid y lt 1 lw 0.5 lc rgb '#dddddd'\nset key tmargin center horizontal samplen 2 "
            "noenhanced\n";
  draw_errors(script, rows);
  draw_second(script, rows.front());
  script << "unset multiplot\n";
  run_gnuplot(script.str(), file);
}

}  // namespace

nlohmann::ordered_json to_json(const TorqueChartOptions& options,
                               const std::vector<TorqueRow>& rows) {
  nlohmann::ordered_json json{{"scene", options.scene},
                              {"method", options.method},
                              {"servo_rate_Hz", options.servo_rate_Hz},
                              {"simulator_rate_Hz", options.simulator_rate_Hz},
                              {"seconds", options.seconds},
                              {"seed", options.seed},
                              {"rows", nlohmann::ordered_json::array()}};
  for (const TorqueRow& row : rows) {
    nlohmann::ordered_json one{{"motion", row.motion},
                               {"torque_rms_Nm", row.torque_rms_Nm},
                               {"force_rms_N", row.force_rms_N},
                               {"force_error_rms_percent", row.force_error_percent}};
    for (std::size_t way = 0; way < kTorqueWays.size(); ++way) {
      const std::string name = to_string(kTorqueWays[way]);
      one[name + "_error_rms_percent"] = row.rms_error_percent[way];
      one[name + "_error_max_percent"] = row.max_error_percent[way];
    }
    json["rows"].push_back(std::move(one));
  }
  return json;
}

std::vector<fs::path> write_torque_chart(const fs::path& folder, const TorqueChartOptions& options,
                                         const std::vector<TorqueRow>& rows) {
  if (rows.empty()) {
    throw ChartError("chart wrist: no motion was measured; give --motions");
  }
  std::error_code problem;
  fs::create_directories(folder, problem);
  if (problem) {
    throw ChartError("chart wrist: " + folder.string() + " can't be made: " + problem.message() +
                     "; choose another folder with --out");
  }
  std::vector<fs::path> files = {folder / "wrist.json"};
  TextWriter out(files.front().string());
  out.write(to_json(options, rows).dump(2) + "\n");
  out.finish();
  for (const TorqueRow& row : rows) {
    files.push_back(folder / ("wrist_" + row.motion + ".csv"));
    write_instants(files.back(), row);
  }
  files.push_back(folder / "wrist.svg");
  draw(files.back(), options, rows);
  return files;
}

}  // namespace forcegrid::evaluation
