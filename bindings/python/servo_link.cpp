// SPDX-License-Identifier: Apache-2.0
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bindings/python/bind.h"
#include "bindings/python/guarded.h"
#include "bindings/python/link_types.h"
#include "link/servo_endpoint.h"
#include "link/surface_patch.h"

namespace forcegrid::python {
namespace {

using link::ForceSample;
using link::ServoEndpoint;
using link::SurfacePatch;

// The servo's end, which numbers its messages itself.
class ServoLink {
 public:
  ServoLink(const std::string& simulator, const std::vector<std::string>& key_files,
            bool sensitivities)
      : endpoint_(std::make_unique<ServoEndpoint>(
            simulator, ServoEndpoint::random_session_id(), link::load_keys(key_files), 0,
            sensitivities ? link::Content::kSensitivities : link::Content::kPose)) {}

  ServoEndpoint& endpoint() {
    if (!endpoint_) {
      throw link::LinkError("this ServoLink is closed");
    }
    return *endpoint_;
  }
  void close() {
    guard.without_gil([&] { endpoint_.reset(); });
  }

  Guard guard;
  std::uint32_t states = 0;   // sent
  std::uint32_t queries = 0;  // sent

 private:
  std::unique_ptr<ServoEndpoint> endpoint_;
};

template <typename Message>
void send(ServoLink& self, const Message& message, const char* what) {
  const link::SendStatus status = self.guard.alone([&] { return self.endpoint().send(message); });
  if (status == link::SendStatus::kInvalid) {
    throw py::value_error(std::string(what) +
                          " is not finite or out of range; see docs/link_protocol.md");
  }
}

std::uint32_t send_tool_state(ServoLink& self, std::int64_t servo_time_ns,
                              const py::object& position_W_m, const py::object& velocity_W_m_per_s,
                              const py::object& orientation_WT,
                              const py::object& angular_velocity_W_rad_per_s,
                              std::optional<std::uint32_t> buttons) {
  link::ToolState state;
  state.servo_time_ns = servo_time_ns;
  state.position_W_m = link_vector(position_W_m, "position_W_m");
  state.velocity_W_m_per_s = link_vector(velocity_W_m_per_s, "velocity_W_m_per_s");
  const link::Vector3 angular_velocity_W =
      link_vector(angular_velocity_W_rad_per_s, "angular_velocity_W_rad_per_s");
  if (!orientation_WT.is_none()) {
    state.has_orientation = true;
    state.orientation_WT =
        link_numbers<4>(orientation_WT, "orientation_WT", "four numbers: w, x, y, z");
    state.angular_velocity_W_rad_per_s = angular_velocity_W;
  } else if (angular_velocity_W != link::Vector3{}) {
    throw py::value_error("angular_velocity_W_rad_per_s needs an orientation_WT");
  }
  state.has_buttons = buttons.has_value();
  state.buttons = buttons.value_or(0);
  state.sequence = ++self.states;
  send(self, state, "the tool state");
  return state.sequence;
}

std::uint32_t send_query(ServoLink& self, std::int64_t servo_time_ns,
                         const py::object& position_W_m) {
  link::Query query;
  query.servo_time_ns = servo_time_ns;
  query.position_W_m = link_vector(position_W_m, "position_W_m");
  query.query_id = ++self.queries;
  send(self, query, "the query");
  return query.query_id;
}

std::optional<ForceSample> receive(ServoLink& self, double timeout_s) {
  const auto deadline = std::chrono::steady_clock::now() + duration_of(timeout_s, "timeout_s");
  constexpr std::chrono::nanoseconds kSlice = std::chrono::milliseconds(20);  // for signals
  for (;;) {
    const auto sample = self.guard.without_gil([&]() -> std::optional<ForceSample> {
      if (auto arrived = self.endpoint().receive()) {
        return arrived;
      }
      const auto left = deadline - std::chrono::steady_clock::now();
      return self.endpoint().wait(std::min<std::chrono::nanoseconds>(left, kSlice))
                 ? self.endpoint().receive()
                 : std::nullopt;
    });
    raise_for_signals();
    if (sample || std::chrono::steady_clock::now() >= deadline) {
      return sample;
    }
  }
}

py::tuple rows_of(const link::Matrix3& matrix) {
  py::tuple nine(matrix.size());
  for (std::size_t i = 0; i < matrix.size(); ++i) {
    nine[i] = py::float_(matrix[i]);
  }
  return nine;
}

void bind_sample(py::module_& module) {
  py::class_<ForceSample>(module, "ForceSample",
                          "A simulator's answer: the force of the object on the tool. Frame W.")
      .def_readonly("echo_sequence", &ForceSample::echo_sequence,
                    "The tool state that it answers; 0 in the answer to a query.")
      .def_readonly("echo_servo_time_ns", &ForceSample::echo_servo_time_ns)
      .def_readonly("query_id", &ForceSample::query_id, "0 unless it answers a query.")
      .def_readonly("contact_epoch", &ForceSample::contact_epoch)
      .def_readonly("in_contact", &ForceSample::in_contact)
      .def_readonly("converged", &ForceSample::converged)
      .def_readonly("relative_residual", &ForceSample::relative_residual)
      .def_readonly("solve_time_s", &ForceSample::solve_time_s)
      .def_property_readonly(
          "position_W_m", [](const ForceSample& self) { return tuple_of(self.position_W_m); },
          "[m] (x, y, z), where the force was computed")
      .def_property_readonly(
          "force_W_N", [](const ForceSample& self) { return tuple_of(self.force_W_N); },
          "[N] (x, y, z)")
      .def_property_readonly(
          "contact_point_W_m",
          [](const ForceSample& self) { return tuple_of(self.contact_point_W_m); }, "[m] (x, y, z)")
      .def_property_readonly(
          "stiffness_W_N_per_m",
          [](const ForceSample& self) {
            return self.has_stiffness ? py::object(rows_of(self.stiffness_W_N_per_m)) : py::none();
          },
          "[N/m] dF/dP, nine numbers row by row; None if it was not sent")
      .def_property_readonly(
          "torque_W_Nm",
          [](const ForceSample& self) {
            return self.has_torque ? py::object(tuple_of(self.torque_W_Nm)) : py::none();
          },
          "[N m] on the tool about position_W_m; None if it was not sent")
      .def_property_readonly(
          "orientation_WT", [](const ForceSample& self) { return tuple_of(self.orientation_WT); },
          "(w, x, y, z) for which the torque was computed; the identity without one")
      .def_property_readonly(
          "rotational_stiffness_W_Nm_per_rad",
          [](const ForceSample& self) {
            return self.has_rotational_stiffness
                       ? py::object(rows_of(self.rotational_stiffness_W_Nm_per_rad))
                       : py::none();
          },
          "[N m/rad] d(torque)/d(theta), nine numbers row by row; None if it was not sent")
      .def_property_readonly(
          "torque_gradient_W_N",
          [](const ForceSample& self) {
            return self.has_torque_gradient ? py::object(rows_of(self.torque_gradient_W_N))
                                            : py::none();
          },
          "[N] d(torque)/dP, nine numbers row by row; None if it was not sent");
}

py::tuple vertices_of(const SurfacePatch& patch) {
  py::tuple vertices(patch.vertex_count);
  for (std::size_t i = 0; i < patch.vertex_count; ++i) {
    link::Vector3 vertex_W_m = patch.position_W_m;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      vertex_W_m[axis] += static_cast<double>(patch.vertices_W_m[i][axis]);
    }
    vertices[i] = tuple_of(vertex_W_m);
  }
  return vertices;
}

py::tuple triangles_of(const SurfacePatch& patch) {
  py::tuple triangles(patch.triangle_count);
  for (std::size_t i = 0; i < patch.triangle_count; ++i) {
    const SurfacePatch::Triangle& corners = patch.triangles[i];
    triangles[i] = py::make_tuple(corners[0], corners[1], corners[2]);
  }
  return triangles;
}

py::object patch_stiffness_of(const SurfacePatch& patch) {
  if (!patch.has_stiffness) {
    return py::none();
  }
  const auto& six = patch.stiffness_W_N_per_m;
  return py::make_tuple(six[0], six[1], six[2], six[3], six[4], six[5]);
}

py::object press_forces_of(const SurfacePatch& patch) {
  if (!patch.has_press_forces) {
    return py::none();
  }
  const auto force_of = [](const std::array<float, 3>& force_N) {
    return py::make_tuple(force_N[0], force_N[1], force_N[2]);
  };
  return py::make_tuple(force_of(patch.press_forces_W_N[0]), force_of(patch.press_forces_W_N[1]));
}

void bind_patch(py::module_& module) {
  py::class_<SurfacePatch>(module, "SurfacePatch",
                           R"(The part of the surface that the tool may touch next. Frame W.

A simulator sends it with SimulatorLink.show_surface(), while the tool is in the air. Lengths,
stiffness and forces come as 32-bit floats.)")
      .def_readonly("sequence", &SurfacePatch::sequence, "The simulator's own count of patches.")
      .def_readonly("echo_sequence", &SurfacePatch::echo_sequence,
                    "The tool state for which it was made.")
      .def_readonly("echo_servo_time_ns", &SurfacePatch::echo_servo_time_ns)
      .def_readonly("contact_epoch", &SurfacePatch::contact_epoch,
                    "Of the air: it ends where the next contact begins.")
      .def_property_readonly(
          "position_W_m", [](const SurfacePatch& self) { return tuple_of(self.position_W_m); },
          "[m] (x, y, z) of that tool state")
      .def_property_readonly("vertices_W_m", &vertices_of, "[m] (x, y, z) of each, at most 19")
      .def_property_readonly("triangles", &triangles_of,
                             "Three numbers of vertices each, counterclockwise seen from outside, "
                             "at most 27; none: nothing is near.")
      .def_readonly("tool_radius_m", &SurfacePatch::tool_radius_m,
                    "[m] of the simulator's tool, a rod with round ends; 0: a point")
      .def_readonly("tool_length_m", &SurfacePatch::tool_length_m, "[m] of it; 0: a sphere")
      .def_property_readonly(
          "tool_opening_rad",
          [](const SurfacePatch& self) { return self.tool_opening_crad / 100.0; },
          "[rad] above 0 the tool is a grasper of two such rods, this far open")
      .def_property_readonly("stiffness_W_N_per_m", &patch_stiffness_of,
                             "[N/m] dF/dP just after the touch: xx, yy, zz, xy, xz, yz; None if it "
                             "was not sent")
      .def_property_readonly("press_forces_W_N", &press_forces_of,
                             "[N] of a tool that slides, 1 and 2 mm deep; None if not sent");
}

}  // namespace

void bind_servo_link(py::module_& module) {
  bind_sample(module);
  bind_patch(module);
  py::class_<ServoLink>(module, "ServoLink",
                        R"(The servo's end of the link: sends tool states, receives forces.

    with forcegrid.ServoLink("127.0.0.1:24870") as link:
        link.send_tool_state(time.monotonic_ns(), position)
        sample = link.receive(timeout_s=0.1)

What a sample has to be to be taken: docs/link_protocol.md. Threads: calls wait for each other.)")
      .def(py::init<const std::string&, const std::vector<std::string>&, bool>(),
           py::arg("simulator"), py::arg("key_files") = std::vector<std::string>{},
           py::arg("sensitivities") = false,
           R"(simulator: "127.0.0.1:24870", where it listens; it need not run yet.

key_files: files of `forcegrid keygen`; without one only addresses of this machine. sensitivities:
asks for ForceSample.torque_gradient_W_N, too, once a tool state had an orientation. Raises LinkError
saying what to do.)")
      .def("send_tool_state", &send_tool_state, py::arg("servo_time_ns"), py::arg("position_W_m"),
           py::arg("velocity_W_m_per_s") = py::make_tuple(0.0, 0.0, 0.0),
           py::arg("orientation_WT") = py::none(),
           py::arg("angular_velocity_W_rad_per_s") = py::make_tuple(0.0, 0.0, 0.0),
           py::arg("buttons") = py::none(),
           R"(Sends where the tool was at servo_time_ns of this end's clock, frame W.

position_W_m [m], velocity_W_m_per_s [m/s]: three numbers. orientation_WT: of a device with a wrist,
the unit quaternion (w, x, y, z) of the rotation from the tool's frame T to W, and with it
angular_velocity_W_rad_per_s [rad/s]. buttons: bit i, the device's button i is pressed; None: it has
none. Returns its number, which the answer echoes. Raises ValueError for what is not finite or out
of range.)")
      .def("send_query", &send_query, py::arg("servo_time_ns"), py::arg("position_W_m"),
           "Asks for the force at position_W_m [m], frame W. Returns the query's id.")
      .def("receive", &receive, py::arg("timeout_s") = 0.0,
           "The next acceptable ForceSample; None if none comes within timeout_s [s]. Waits "
           "without the GIL.")
      .def(
          "next_patch",
          [](ServoLink& self) {
            return self.guard.alone([&] { return self.endpoint().next_patch(); });
          },
          "The newest acceptable SurfacePatch that receive() has come across since the last call, "
          "or "
          "None.")
      .def_property_readonly(
          "patches_accepted",
          [](ServoLink& self) {
            return self.guard.alone([&] { return self.endpoint().patches_accepted(); });
          },
          "How many have come, also those that a newer one has replaced.")
      .def_property_readonly(
          "simulator_knows_poses",
          [](ServoLink& self) {
            return self.guard.alone([&] { return self.endpoint().simulator_knows_poses(); });
          },
          "False once the simulator has shown that it takes no orientation and sends no torque.")
      .def_property_readonly(
          "simulator_ended",
          [](ServoLink& self) {
            return self.guard.alone([&] { return self.endpoint().simulator_ended(); });
          },
          "Whether the simulator said goodbye and nothing came from it since.")
      .def_property_readonly(
          "dropped",
          [](ServoLink& self) {
            return dropped_of(self.guard.alone([&] { return self.endpoint().statistics(); }));
          },
          "Datagrams that were dropped, by reason: dict.")
      .def("close", &ServoLink::close, "Says goodbye to the simulator.")
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](ServoLink& self, const py::args&) { self.close(); });
}

}  // namespace forcegrid::python
