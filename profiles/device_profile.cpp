#include "profiles/device_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <string_view>

#define TOML_HEADER_ONLY 1
#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

namespace forcegrid::profiles {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxUsbStringLength = 126;  // a string descriptor has 255 bytes at most
constexpr std::array<const char*, 3> kJointNames = {"a (base)", "b (shoulder)", "c (elbow)"};

std::string number_text(double value) {
  std::string text(32, '\0');
  const int length = std::snprintf(text.data(), text.size(), "%.9g", value);
  text.resize(static_cast<std::size_t>(length));
  return text;
}

[[noreturn]] void fail(const std::string& file, std::uint32_t line, const std::string& key,
                       const std::string& problem, const std::string& remedy) {
  throw ProfileError(file + ":" + std::to_string(line) + ": key '" + key + "': " + problem + "; " +
                     remedy);
}

struct Range {
  double min;
  double max;
  const char* words;
};

constexpr double kLargest = std::numeric_limits<double>::max();
constexpr Range kPositive{std::numeric_limits<double>::min(), kLargest, "a number above 0"};
constexpr Range kNotNegative{0.0, kLargest, "0 or a number above it"};
constexpr Range kAnyNumber{-kLargest, kLargest, "a finite number"};
// The arms are table-top devices: a length of metres is a unit mistaken.
constexpr Range kLength_m{1e-4, 2.0, "a length in metres from 0.0001 to 2"};
constexpr Range kPlace_m{-2.0, 2.0, "a coordinate in metres from -2 to 2"};
constexpr Range kAngle_rad{-2.0 * std::numbers::pi, 2.0 * std::numbers::pi,
                           "an angle in radians from -2 pi to 2 pi"};

/// One table of the file: knows its keys, so that an unknown or missing one is an error that names
/// its line.
class Table {
 public:
  Table(const toml::table& table, std::string file, std::string path,
        std::initializer_list<const char*> keys)
      : table_(table), file_(std::move(file)), path_(std::move(path)) {
    std::string known;
    for (const char* key : keys) {
      known += (known.empty() ? "" : ", ") + std::string(key);
    }
    for (const auto& [key, node] : table_) {
      if (std::none_of(keys.begin(), keys.end(),
                       [&key = key](const char* name) { return key.str() == name; })) {
        fail(file_, key.source().begin.line, full(key.str()),
             node.is_table() ? "unknown table" : "unknown key", "write one of: " + known);
      }
    }
  }

  std::uint32_t line_of(std::string_view key) const {
    const toml::node* node = table_.get(key);
    return node != nullptr ? node->source().begin.line : table_line();
  }

  Table table(const char* key, std::initializer_list<const char*> keys) const {
    const toml::table* inner = required(key, "a table [" + full(key) + "]").as_table();
    if (inner == nullptr) {
      refuse(key, "it is not a table", "write a table [" + full(key) + "]");
    }
    return Table(*inner, file_, full(key), keys);
  }

  std::string text(const char* key, std::size_t max_length = 1000) const {
    const auto* value = required(key, "a string").as_string();
    if (value == nullptr) {
      refuse(key, "wrong type", "write a string in quotes");
    }
    if (value->get().empty() || value->get().size() > max_length) {
      refuse(key, "it has " + std::to_string(value->get().size()) + " characters",
             "write a string of 1 to " + std::to_string(max_length) + " characters");
    }
    return value->get();
  }

  bool flag(const char* key) const {
    const auto* value = required(key, "true or false").as_boolean();
    if (value == nullptr) {
      refuse(key, "wrong type", "write true or false");
    }
    return value->get();
  }

  double number(const char* key, const Range& range) const {
    return number_of(required(key, range.words), key, range, "");
  }

  std::int64_t integer(const char* key, std::int64_t min, std::int64_t max) const {
    return integer_of(required(key, integer_words(min, max)), key, min, max, "");
  }

  Axes axes(const char* key, const Range& range) const {
    const std::string words = std::string("three times ") + range.words;
    const toml::array& array = array_of(key, 3, words);
    Axes result{};
    for (std::size_t i = 0; i < 3; ++i) {
      result[i] = number_of(array[i], key, range, " in place " + std::to_string(i + 1));
    }
    return result;
  }

  Axes signs(const char* key) const {
    const Axes result = axes(key, kAnyNumber);
    for (std::size_t i = 0; i < 3; ++i) {
      if (result[i] != 1.0 && result[i] != -1.0) {
        refuse(key, number_text(result[i]) + " in place " + std::to_string(i + 1) + " is no sign",
               "write 1 or -1");
      }
    }
    return result;
  }

  std::array<int, 6> counters(const char* key) const {
    constexpr std::int64_t kMin = std::numeric_limits<std::int16_t>::min();
    constexpr std::int64_t kMax = std::numeric_limits<std::int16_t>::max();
    const toml::array& array = array_of(key, 6, "six times " + integer_words(kMin, kMax));
    std::array<int, 6> result{};
    for (std::size_t i = 0; i < 6; ++i) {
      result[i] = static_cast<int>(
          integer_of(array[i], key, kMin, kMax, " in place " + std::to_string(i + 1)));
    }
    return result;
  }

  [[noreturn]] void refuse(const char* key, const std::string& problem,
                           const std::string& remedy) const {
    fail(file_, line_of(key), full(key), problem, remedy);
  }

 private:
  std::string full(std::string_view key) const {
    return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
  }

  std::uint32_t table_line() const { return std::max(table_.source().begin.line, 1U); }

  const toml::node& required(const char* key, const std::string& what) const {
    const toml::node* node = table_.get(key);
    if (node == nullptr) {
      fail(file_, table_line(), full(key), "missing", "write " + what);
    }
    return *node;
  }

  const toml::array& array_of(const char* key, std::size_t size, const std::string& words) const {
    const auto* array = required(key, words + " in brackets").as_array();
    if (array == nullptr) {
      refuse(key, "wrong type", "write " + words + ", in brackets");
    }
    if (array->size() != size) {
      refuse(key, "it has " + std::to_string(array->size()) + " elements",
             "write " + words + ", in brackets");
    }
    return *array;
  }

  double number_of(const toml::node& node, const char* key, const Range& range,
                   const std::string& place) const {
    double value = 0.0;
    if (const auto* real = node.as_floating_point()) {
      value = real->get();
    } else if (const auto* whole = node.as_integer()) {
      value = static_cast<double>(whole->get());
    } else {
      refuse(key, "wrong type" + place, std::string("write ") + range.words);
    }
    if (!std::isfinite(value)) {
      refuse(key, "not finite" + place, std::string("write ") + range.words);
    }
    if (value < range.min || value > range.max) {
      refuse(key, number_text(value) + place + " is impossible",
             std::string("write ") + range.words);
    }
    return value;
  }

  static std::string integer_words(std::int64_t min, std::int64_t max) {
    return "a whole number from " + std::to_string(min) + " to " + std::to_string(max);
  }

  std::int64_t integer_of(const toml::node& node, const char* key, std::int64_t min,
                          std::int64_t max, const std::string& place) const {
    const auto* whole = node.as_integer();
    if (whole == nullptr) {
      refuse(key, "wrong type" + place, "write " + integer_words(min, max));
    }
    if (whole->get() < min || whole->get() > max) {
      refuse(key, std::to_string(whole->get()) + place + " is impossible",
             "write " + integer_words(min, max));
    }
    return whole->get();
  }

  const toml::table& table_;
  std::string file_;
  std::string path_;
};

std::uint16_t word(const Table& table, const char* key) {
  return static_cast<std::uint16_t>(table.integer(key, 0, 0xFFFF));
}

DeviceProfile::Usb read_usb(const Table& root) {
  const Table table = root.table(
      "usb", {"protocol", "vendor_id", "product_id", "device_release", "manufacturer", "product",
              "serial", "usage_page", "usage", "report_bytes", "frame_period_us"});
  DeviceProfile::Usb usb;
  usb.protocol = table.text("protocol");
  if (usb.protocol != "w2") {
    table.refuse("protocol", "'" + usb.protocol + "' is unknown", "write \"w2\"");
  }
  usb.vendor_id = word(table, "vendor_id");
  usb.product_id = word(table, "product_id");
  usb.device_release = word(table, "device_release");
  usb.manufacturer = table.text("manufacturer", kMaxUsbStringLength);
  usb.product = table.text("product", kMaxUsbStringLength);
  usb.serial = table.text("serial", kMaxUsbStringLength);
  usb.usage_page = word(table, "usage_page");
  usb.usage = word(table, "usage");
  usb.report_bytes = static_cast<int>(table.integer("report_bytes", 14, 14));
  usb.frame_period_us = static_cast<int>(table.integer("frame_period_us", 125, 1000));
  if (usb.frame_period_us != 125 && usb.frame_period_us != 1000) {
    table.refuse("frame_period_us", std::to_string(usb.frame_period_us) + " is impossible",
                 "write 1000 (full speed) or 125 (high speed)");
  }
  return usb;
}

DeviceProfile::Kinematics read_kinematics(const Table& root) {
  const Table table =
      root.table("kinematics",
                 {"link_length_m", "origin_m", "capstan_diameter_m", "body_diameter_m",
                  "encoder_counts_per_turn", "encoder_sign", "linkage_sign", "linkage_offset_rad",
                  "joint_min_rad", "joint_max_rad", "elbow_min_rad", "elbow_max_rad"});
  DeviceProfile::Kinematics kinematics;
  // Some configurations put the height of the base into the origin: only L_a may be zero.
  kinematics.link_length_m = table.axes("link_length_m", {0.0, 2.0, "a length in metres up to 2"});
  for (std::size_t i = 1; i < 3; ++i) {
    if (kinematics.link_length_m[i] < kLength_m.min) {
      table.refuse("link_length_m",
                   number_text(kinematics.link_length_m[i]) + " in place " + std::to_string(i + 1) +
                       " is impossible",
                   std::string("write ") + kLength_m.words);
    }
  }
  kinematics.origin_m = table.axes("origin_m", kPlace_m);
  kinematics.capstan_diameter_m = table.axes("capstan_diameter_m", kLength_m);
  kinematics.body_diameter_m = table.axes("body_diameter_m", kLength_m);
  kinematics.encoder_counts_per_turn = table.axes(
      "encoder_counts_per_turn", {1.0, 1e7, "a number of quadrature counts from 1 to 1e7"});
  kinematics.encoder_sign = table.signs("encoder_sign");
  kinematics.linkage_sign = table.signs("linkage_sign");
  kinematics.linkage_offset_rad = table.axes("linkage_offset_rad", kAngle_rad);
  kinematics.joint_min_rad = table.axes("joint_min_rad", kAngle_rad);
  kinematics.joint_max_rad = table.axes("joint_max_rad", kAngle_rad);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(kinematics.joint_min_rad[i] < kinematics.joint_max_rad[i])) {
      table.refuse("joint_max_rad",
                   std::string("joint ") + kJointNames[i] + ": not above joint_min_rad (" +
                       number_text(kinematics.joint_min_rad[i]) + ")",
                   "write a larger angle here or a smaller one there");
    }
  }
  constexpr Range kElbow{0.0, std::numbers::pi, "an angle in radians from 0 to pi"};
  kinematics.elbow_min_rad = table.number("elbow_min_rad", kElbow);
  kinematics.elbow_max_rad = table.number("elbow_max_rad", kElbow);
  if (!(kinematics.elbow_min_rad < kinematics.elbow_max_rad)) {
    table.refuse("elbow_max_rad",
                 "not above elbow_min_rad (" + number_text(kinematics.elbow_min_rad) + ")",
                 "write a larger angle here or a smaller one there");
  }
  return kinematics;
}

DeviceProfile::Motors read_motors(const Table& root) {
  const Table table =
      root.table("motors", {"torque_constant_Nm_per_A", "max_current_A", "full_scale_current_A"});
  DeviceProfile::Motors motors;
  motors.torque_constant_Nm_per_A = table.axes("torque_constant_Nm_per_A", kPositive);
  motors.full_scale_current_A =
      table.number("full_scale_current_A", {1e-3, 32.0, "a current in amperes from 0.001 to 32"});
  motors.max_current_A = table.axes("max_current_A", kPositive);
  for (std::size_t i = 0; i < 3; ++i) {
    if (motors.max_current_A[i] > motors.full_scale_current_A) {
      table.refuse("max_current_A",
                   number_text(motors.max_current_A[i]) + " in place " + std::to_string(i + 1) +
                       " is above full_scale_current_A",
                   "write at most " + number_text(motors.full_scale_current_A) +
                       ": the firmware does not clamp");
    }
  }
  return motors;
}

DeviceProfile::Limits read_limits(const Table& root) {
  const Table table =
      root.table("limits", {"max_force_N", "max_force_rate_N_per_s", "max_joint_torque_Nm",
                            "max_stiffness_N_per_m", "max_damping_N_s_per_m", "max_speed_m_per_s",
                            "workspace_min_m", "workspace_max_m"});
  DeviceProfile::Limits limits;
  limits.max_force_N = table.number("max_force_N", kPositive);
  limits.max_force_rate_N_per_s = table.number("max_force_rate_N_per_s", kPositive);
  limits.max_joint_torque_Nm = table.axes("max_joint_torque_Nm", kPositive);
  limits.max_stiffness_N_per_m = table.number("max_stiffness_N_per_m", kPositive);
  limits.max_damping_N_s_per_m = table.number("max_damping_N_s_per_m", kNotNegative);
  limits.max_speed_m_per_s = table.number("max_speed_m_per_s", kPositive);
  limits.workspace_min_m = table.axes("workspace_min_m", kPlace_m);
  limits.workspace_max_m = table.axes("workspace_max_m", kPlace_m);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(limits.workspace_min_m[i] < limits.workspace_max_m[i])) {
      table.refuse("workspace_max_m",
                   number_text(limits.workspace_max_m[i]) + " in place " + std::to_string(i + 1) +
                       " is not above workspace_min_m",
                   "write a larger coordinate here or a smaller one there");
    }
  }
  return limits;
}

DeviceProfile::Calibration read_calibration(const Table& root,
                                            const DeviceProfile::Kinematics& kinematics) {
  const Table table = root.table("calibration", {"pose_counts", "instruction"});
  DeviceProfile::Calibration calibration;
  calibration.pose_counts = table.counters("pose_counts");
  calibration.instruction = table.text("instruction");
  double elbow_rad = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double joint_rad = kinematics.encoder_sign[i] * 2.0 * std::numbers::pi *
                             calibration.pose_counts[i] / kinematics.encoder_counts_per_turn[i] *
                             kinematics.capstan_diameter_m[i] / kinematics.body_diameter_m[i];
    if (joint_rad < kinematics.joint_min_rad[i] || joint_rad > kinematics.joint_max_rad[i]) {
      table.refuse("pose_counts",
                   std::string("joint ") + kJointNames[i] + " would be at " +
                       number_text(joint_rad) + " rad, beyond its hard stops",
                   "write the counts of a pose between kinematics.joint_min_rad and "
                   "joint_max_rad");
    }
    if (i > 0) {
      elbow_rad += kinematics.linkage_offset_rad[i] + kinematics.linkage_sign[i] * joint_rad;
    }
  }
  if (elbow_rad < kinematics.elbow_min_rad || elbow_rad > kinematics.elbow_max_rad) {
    table.refuse("pose_counts",
                 "the angle between the links would be " + number_text(elbow_rad) +
                     " rad, beyond its hard stops",
                 "write the counts of a pose between kinematics.elbow_min_rad and elbow_max_rad");
  }
  return calibration;
}

DeviceProfile::Gravity read_gravity(const Table& root) {
  const Table table =
      root.table("gravity", {"acceleration_m_per_s2", "link_b_mass_kg", "link_c_mass_kg",
                             "link_b_center_m", "link_c_center_m", "balanced"});
  DeviceProfile::Gravity gravity;
  gravity.acceleration_m_per_s2 = table.number("acceleration_m_per_s2", kNotNegative);
  gravity.link_b_mass_kg = table.number("link_b_mass_kg", kNotNegative);
  gravity.link_c_mass_kg = table.number("link_c_mass_kg", kNotNegative);
  // A centre of mass behind the joint (a counterweight) is negative.
  gravity.link_b_center_m = table.number("link_b_center_m", kPlace_m);
  gravity.link_c_center_m = table.number("link_c_center_m", kPlace_m);
  gravity.balanced = table.flag("balanced");
  return gravity;
}

DeviceProfile::Dynamics read_dynamics(const Table& root) {
  const Table table =
      root.table("dynamics", {"tip_mass_kg", "joint_inertia_kg_m2", "coulomb_friction_Nm",
                              "coulomb_smoothing_s_per_rad", "viscous_friction_Nm_s_per_rad",
                              "stop_stiffness_Nm_per_rad", "stop_damping_Nm_s_per_rad"});
  DeviceProfile::Dynamics dynamics;
  dynamics.tip_mass_kg = table.number("tip_mass_kg", kPositive);
  dynamics.joint_inertia_kg_m2 = table.number("joint_inertia_kg_m2", kPositive);
  dynamics.coulomb_friction_Nm = table.number("coulomb_friction_Nm", kNotNegative);
  dynamics.coulomb_smoothing_s_per_rad = table.number("coulomb_smoothing_s_per_rad", kPositive);
  dynamics.viscous_friction_Nm_s_per_rad =
      table.number("viscous_friction_Nm_s_per_rad", kNotNegative);
  dynamics.stop_stiffness_Nm_per_rad = table.number("stop_stiffness_Nm_per_rad", kPositive);
  dynamics.stop_damping_Nm_s_per_rad = table.number("stop_damping_Nm_s_per_rad", kNotNegative);
  return dynamics;
}

HandProfile read_hand(const Table& root, const char* key) {
  const Table table =
      root.table(key, {"mass_kg", "damping_N_s_per_m", "stiffness_N_per_m", "source"});
  HandProfile hand;
  hand.mass_kg = table.number("mass_kg", kPositive);
  hand.damping_N_s_per_m = table.number("damping_N_s_per_m", kNotNegative);
  hand.stiffness_N_per_m = table.number("stiffness_N_per_m", kPositive);
  hand.source = table.text("source");
  return hand;
}

std::vector<fs::path> search_folders() {
  std::vector<fs::path> folders;
  if (const char* path = std::getenv("FORCEGRID_PROFILE_PATH"); path != nullptr) {
    std::string_view rest = path;
    while (!rest.empty()) {
      const std::size_t colon = std::min(rest.find(':'), rest.size());
      if (colon > 0) {
        folders.emplace_back(rest.substr(0, colon));
      }
      rest.remove_prefix(std::min(colon + 1, rest.size()));
    }
  }
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) {
    folders.push_back(program.parent_path().parent_path() / "share/forcegrid/profiles");
  }
  folders.emplace_back(FORCEGRID_PROFILE_SOURCE_DIR);
  return folders;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

std::string find_file(const std::string& name_or_path) {
  if (name_or_path.find('/') != std::string::npos || name_or_path.ends_with(".toml")) {
    return name_or_path;
  }
  if (!name_or_path.empty()) {
    for (const fs::path& folder : search_folders()) {
      const fs::path candidate = folder / (name_or_path + ".toml");
      std::error_code error;
      if (fs::is_regular_file(candidate, error)) {
        return candidate.string();
      }
    }
  }
  throw ProfileError("device profile '" + name_or_path + "': unknown; write one of: " +
                     joined(available_profiles()) + ", or a file name that ends in .toml");
}

}  // namespace

DeviceProfile load_device_profile(const std::string& name_or_path) {
  const std::string file = find_file(name_or_path);
  std::error_code error;
  if (!fs::exists(file, error)) {
    throw ProfileError(
        "device profile '" + file +
        "': no such file; write the path of a profile or one of: " + joined(available_profiles()));
  }
  if (!fs::is_regular_file(file, error)) {
    throw ProfileError("device profile '" + file +
                       "': not a regular file; write the path of a .toml file");
  }
  toml::table parsed;
  try {
    parsed = toml::parse_file(file);
  } catch (const toml::parse_error& problem) {
    // A line of 0 means that the file could not be read at all.
    const std::uint32_t line = problem.source().begin.line;
    throw ProfileError(file + ":" + std::to_string(line) + ": " +
                       std::string(problem.description()) +
                       (line == 0 ? "; make the file readable" : "; correct the TOML syntax"));
  }
  const Table root(parsed, file, "",
                   {"name", "description", "source", "usb", "kinematics", "motors", "limits",
                    "calibration", "gravity", "dynamics", "firm_hand", "light_hand"});
  DeviceProfile profile;
  profile.file = file;
  profile.name = root.text("name");
  profile.description = root.text("description");
  profile.source = root.text("source");
  profile.usb = read_usb(root);
  profile.kinematics = read_kinematics(root);
  profile.motors = read_motors(root);
  profile.limits = read_limits(root);
  profile.calibration = read_calibration(root, profile.kinematics);
  profile.gravity = read_gravity(root);
  profile.dynamics = read_dynamics(root);
  profile.firm_hand = read_hand(root, "firm_hand");
  profile.light_hand = read_hand(root, "light_hand");
  return profile;
}

std::vector<std::string> available_profiles() {
  std::set<std::string> names;
  for (const fs::path& folder : search_folders()) {
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == ".toml") {
        names.insert(entry.path().stem().string());
      }
    }
  }
  return {names.begin(), names.end()};
}

}  // namespace forcegrid::profiles
