// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

/// The parts of the module `forcegrid._core`; each adds its classes and functions.
namespace forcegrid::python {

void bind_device(pybind11::module_& module);
void bind_profiles(pybind11::module_& module);
void bind_kinematics(pybind11::module_& module);
void bind_methods(pybind11::module_& module);
void bind_traces(pybind11::module_& module);
void bind_recordings(pybind11::module_& module);
void bind_simulator_link(pybind11::module_& module);
void bind_servo_link(pybind11::module_& module);

}  // namespace forcegrid::python
