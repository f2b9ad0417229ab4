// SPDX-License-Identifier: Apache-2.0
#include "tools/unit_profile.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>

#include "driver/device_url.h"
#include "tools/atomic_file.h"
#include "tools/config_file.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

constexpr char kSerialOfEveryMbed[] = "0123456789";
constexpr char kEmulated[] = "emulated";

std::string fit_for_a_name(const std::string& text) {
  std::string result = text;
  std::replace_if(
      result.begin(), result.end(),
      [](unsigned char c) { return std::isalnum(c) == 0 && c != '.' && c != '-'; }, '_');
  return result;
}

// Folders of calibrated profiles beside the configuration files, the user's first.
std::vector<std::string> folders() {
  std::vector<std::string> result;
  for (const ConfigLayer& layer : config_layers("")) {
    result.insert(result.begin(), (fs::path(layer.file).parent_path() / "devices").string());
  }
  return result;
}

std::string file_name(const std::string& profile_name, const std::string& key) {
  return profile_name + "@" + key + ".toml";
}

}  // namespace

std::string unit_key(const driver::DeviceIdentity& identity, const std::string& lasting_url) {
  if (lasting_url == kEmulated) {
    return kEmulated;
  }
  if (!identity.serial.empty() && identity.serial != kSerialOfEveryMbed) {
    return "serial-" + fit_for_a_name(identity.serial);
  }
  const driver::DeviceUrl url = driver::parse_device_url(lasting_url);
  if (!url.port_path.empty()) {
    return "port-" + fit_for_a_name(url.port_path);
  }
  if (url.kind == driver::DeviceUrl::Kind::kUsbip) {
    return "usbip-" + fit_for_a_name(url.host) + "-" + fit_for_a_name(url.bus_id);
  }
  return "at-" + fit_for_a_name(lasting_url);
}

std::string unit_profile_file(const std::string& profile_name, const std::string& key) {
  const std::vector<ConfigLayer> layers = config_layers("");
  if (layers.back().name != "user") {
    throw UnitProfileError(
        "no folder for calibrated profiles; set HOME, or XDG_CONFIG_HOME to an absolute "
        "path, or name a file with --write");
  }
  return folders().front() + "/" + file_name(profile_name, key);
}

std::optional<std::string> find_unit_profile(const std::string& profile_name,
                                             const std::string& key) {
  for (const std::string& folder : folders()) {
    const std::string file = folder + "/" + file_name(profile_name, key);
    std::error_code error;
    if (fs::is_regular_file(file, error)) {
      return file;
    }
  }
  return std::nullopt;
}

void write_unit_profile(const std::string& file, const std::string& base,
                        const std::string& heading,
                        const std::vector<std::pair<std::string, std::string>>& changes) {
  std::vector<std::string> lines{"# " + heading};
  std::ifstream stream(base);
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  if (stream.bad() || lines.size() == 1) {
    throw UnitProfileError("profile " + base + " can't be read; make it readable");
  }
  for (const auto& [key, value] : changes) {
    set_toml_key(lines, key, value);
  }
  std::string text;
  for (const std::string& line : lines) {
    text += line + "\n";
  }
  try {
    replace_file(file, text, [&](const std::string& written) {
      static_cast<void>(profiles::load_device_profile(written));
    });
  } catch (const profiles::ProfileError& error) {
    throw UnitProfileError(
        file + " was not written, because the result would be an invalid profile: " + error.what());
  } catch (const AtomicFileError& error) {
    throw UnitProfileError(error.what());
  }
}

}  // namespace forcegrid::tools
