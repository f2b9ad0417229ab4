// SPDX-License-Identifier: Apache-2.0
#include <pybind11/pybind11.h>

#include <filesystem>

#include "bindings/python/bind.h"
#include "text/data_folder.h"
#include "text/own_prefix.h"

namespace {

// A wheel has its profiles in a folder of its own.
void find_data() {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path share = fs::path(forcegrid::text::own_file()).parent_path() / "share";
  if (fs::is_directory(share / "profiles", error)) {
    forcegrid::text::set_installed_data(share.string());
  }
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The compiled part of the package forcegrid.";
  module.attr("__version__") = FORCEGRID_VERSION;
  find_data();
  forcegrid::python::bind_profiles(module);
  forcegrid::python::bind_kinematics(module);
  forcegrid::python::bind_methods(module);
  forcegrid::python::bind_traces(module);
  forcegrid::python::bind_recordings(module);
  forcegrid::python::bind_simulator_link(module);
  forcegrid::python::bind_servo_link(module);
  forcegrid::python::bind_device(module);
}
