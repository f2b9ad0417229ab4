// SPDX-License-Identifier: Apache-2.0
#include "tools/library_versions.h"

#include <gnu/libc-version.h>
#include <hwy/highway.h>
#include <sys/utsname.h>
#include <toml++/impl/version.h>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "driver/library_versions.h"
#include "link/library_versions.h"
#include "log/log.h"
#include "simulator/library_versions.h"
#include "tools/hdf5_file.h"

namespace forcegrid::tools {
namespace {

std::string dotted(int major, int minor, int patch) {
  return std::to_string(major) + '.' + std::to_string(minor) + '.' + std::to_string(patch);
}

}  // namespace

std::vector<PartVersion> library_versions() {
  std::vector<PartVersion> parts;
  for (const auto& versions :
       {driver::library_versions(), link::library_versions(), simulator::library_versions()}) {
    for (const auto& [name, version] : versions) {
      parts.push_back({name, version});
    }
  }
  parts.push_back({"HDF5", hdf5_version()});
  parts.push_back({"glibc", gnu_get_libc_version()});
  utsname system{};
  uname(&system);
  parts.push_back({"kernel", std::string(system.sysname) + ' ' + system.release + ' ' +
                                 system.version + ' ' + system.machine});
  parts.push_back(
      {"Eigen", dotted(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION), false});
  parts.push_back({"Highway", dotted(HWY_MAJOR, HWY_MINOR, HWY_PATCH), false});
  parts.push_back({"tomlplusplus", dotted(TOML_LIB_MAJOR, TOML_LIB_MINOR, TOML_LIB_PATCH), false});
  parts.push_back({"nlohmann-json",
                   dotted(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR,
                          NLOHMANN_JSON_VERSION_PATCH),
                   false});
  parts.push_back({"spdlog", log::library_version(), false});
  parts.push_back({"tinyobjloader", FORCEGRID_TINYOBJLOADER_VERSION, false});
  parts.push_back({"compiler", __VERSION__, false});
  return parts;
}

}  // namespace forcegrid::tools
