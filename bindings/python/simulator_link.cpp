// SPDX-License-Identifier: Apache-2.0
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "bindings/python/guarded.h"
#include "bindings/python/link_types.h"
#include "link/simulator_endpoint.h"
#include "link/wire.h"

namespace forcegrid::python {
namespace {

using link::ForceSample;
using link::Query;
using link::SimulatorEndpoint;
using link::SurfacePatch;
using link::ToolState;

std::string address_text(const std::string& host, int port) {
  return (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" +
         std::to_string(port);
}

// The simulator's end. closed: every function but close() raises LinkError.
class SimulatorLink {
 public:
  SimulatorLink(const std::string& host, int port, const std::vector<std::string>& key_files,
                double silence_s) {
    link::Access access;
    access.keys = link::load_keys(key_files);
    endpoint_ = std::make_unique<SimulatorEndpoint>(
        address_text(host, port), duration_of(silence_s, "silence_s"), std::move(access));
  }

  SimulatorEndpoint& endpoint() {
    if (!endpoint_) {
      throw link::LinkError("this SimulatorLink is closed");
    }
    return *endpoint_;
  }

  Guard guard;
  void close() {
    guard.without_gil([&] { endpoint_.reset(); });
  }

 private:
  std::unique_ptr<SimulatorEndpoint> endpoint_;
};

SimulatorEndpoint::News receive(SimulatorLink& self, double timeout_s) {
  const std::chrono::nanoseconds timeout = duration_of(timeout_s, "timeout_s");
  const SimulatorEndpoint::News news =
      self.guard.without_gil([&] { return self.endpoint().receive(timeout); });
  raise_for_signals();
  return news;
}

void send(SimulatorLink& self, const auto& message, const char* what) {
  const link::SendStatus status = self.guard.alone([&] { return self.endpoint().send(message); });
  if (status == link::SendStatus::kInvalid) {
    throw py::value_error(std::string(what) +
                          " is not finite or out of range; see docs/link_protocol.md");
  }
}

ForceSample answer_to_any(const py::object& request) {
  if (py::isinstance<ToolState>(request)) {
    return link::answer_to(request.cast<const ToolState&>());
  }
  if (py::isinstance<Query>(request)) {
    return link::answer_to(request.cast<const Query&>());
  }
  throw py::type_error("request: expected a ToolState or a Query");
}

void set_torque(ForceSample& sample, const py::object& torque_W_Nm,
                const py::object& orientation_WT,
                const py::object& rotational_stiffness_W_Nm_per_rad,
                const py::object& torque_gradient_W_N) {
  if (!torque_W_Nm.is_none()) {
    sample.has_torque = true;
    sample.torque_W_Nm = link_vector(torque_W_Nm, "torque_W_Nm");
  }
  if (!orientation_WT.is_none()) {
    sample.orientation_WT =
        link_numbers<4>(orientation_WT, "orientation_WT", "four numbers: w, x, y, z");
  }
  if (!rotational_stiffness_W_Nm_per_rad.is_none()) {
    if (!sample.has_torque) {
      throw py::value_error("rotational_stiffness_W_Nm_per_rad needs a torque_W_Nm");
    }
    sample.has_rotational_stiffness = true;
    sample.rotational_stiffness_W_Nm_per_rad =
        link_numbers<9>(rotational_stiffness_W_Nm_per_rad, "rotational_stiffness_W_Nm_per_rad",
                        "9 numbers, row by row");
  }
  if (!torque_gradient_W_N.is_none()) {
    if (!sample.has_torque) {
      throw py::value_error("torque_gradient_W_N needs a torque_W_Nm");
    }
    sample.has_torque_gradient = true;
    sample.torque_gradient_W_N =
        link_numbers<9>(torque_gradient_W_N, "torque_gradient_W_N", "9 numbers, row by row");
  }
}

void answer(SimulatorLink& self, const py::object& request, const py::object& force_W_N,
            bool in_contact, bool converged, const py::object& stiffness_W_N_per_m,
            const py::object& position_W_m, const py::object& contact_point_W_m,
            std::uint32_t contact_epoch, double relative_residual, double solve_time_s,
            const py::object& torque_W_Nm, const py::object& orientation_WT,
            const py::object& rotational_stiffness_W_Nm_per_rad,
            const py::object& torque_gradient_W_N) {
  ForceSample sample = answer_to_any(request);
  sample.force_W_N = link_vector(force_W_N, "force_W_N");
  sample.in_contact = in_contact;
  sample.converged = converged;
  sample.contact_epoch = contact_epoch;
  sample.relative_residual = relative_residual;
  sample.solve_time_s = solve_time_s;
  if (!position_W_m.is_none()) {
    sample.position_W_m = link_vector(position_W_m, "position_W_m");
  }
  sample.contact_point_W_m = contact_point_W_m.is_none()
                                 ? sample.position_W_m
                                 : link_vector(contact_point_W_m, "contact_point_W_m");
  if (!stiffness_W_N_per_m.is_none()) {
    sample.has_stiffness = true;
    sample.stiffness_W_N_per_m =
        link_numbers<9>(stiffness_W_N_per_m, "stiffness_W_N_per_m", "9 numbers, row by row");
  }
  set_torque(sample, torque_W_Nm, orientation_WT, rotational_stiffness_W_Nm_per_rad,
             torque_gradient_W_N);
  send(self, sample, "the answer");
}

void set_vertices(SurfacePatch& patch, const py::sequence& vertices_W_m,
                  const py::sequence& triangles) {
  if (py::len(vertices_W_m) > SurfacePatch::kMaxVertices ||
      py::len(triangles) > SurfacePatch::kMaxTriangles) {
    throw py::value_error("the patch is too large: at most 19 vertices and 27 triangles");
  }
  for (const py::handle& vertex : vertices_W_m) {
    const link::Vector3 position = link_vector(vertex, "vertices_W_m");
    auto& offset = patch.vertices_W_m[patch.vertex_count++];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      offset[axis] = static_cast<float>(position[axis] - patch.position_W_m[axis]);
    }
  }
  for (const py::handle& triangle : triangles) {
    const link::Vector3 corners = link_vector(triangle, "triangles");
    auto& to = patch.triangles[patch.triangle_count++];
    for (std::size_t i = 0; i < 3; ++i) {
      if (!(corners[i] >= 0.0 && corners[i] < patch.vertex_count)) {
        throw py::value_error("triangles: a corner is not the number of a vertex");
      }
      to[i] = static_cast<std::uint8_t>(corners[i]);
    }
  }
}

void show_surface(SimulatorLink& self, const ToolState& tool_state,
                  const py::sequence& vertices_W_m, const py::sequence& triangles,
                  std::uint32_t contact_epoch, double tool_radius_m, double tool_length_m,
                  const py::object& stiffness_W_N_per_m, const py::object& press_forces_W_N,
                  double tool_opening_rad) {
  const auto narrowed = [](double number) { return static_cast<float>(number); };
  SurfacePatch patch = link::patch_for(tool_state);
  patch.contact_epoch = contact_epoch;
  patch.tool_radius_m = static_cast<float>(tool_radius_m);
  patch.tool_length_m = static_cast<float>(tool_length_m);
  const double opening_crad = std::round(100.0 * tool_opening_rad);
  if (!(opening_crad >= 0.0 && opening_crad <= SurfacePatch::kMaxToolOpening_crad)) {
    throw py::value_error("tool_opening_rad: expected 0 to 1.6 rad");
  }
  patch.tool_opening_crad = static_cast<std::uint8_t>(opening_crad);
  set_vertices(patch, vertices_W_m, triangles);
  if (!stiffness_W_N_per_m.is_none()) {
    patch.has_stiffness = true;
    const auto six = link_numbers<6>(stiffness_W_N_per_m, "stiffness_W_N_per_m", "6 numbers");
    std::transform(six.begin(), six.end(), patch.stiffness_W_N_per_m.begin(), narrowed);
  }
  if (!press_forces_W_N.is_none()) {
    patch.has_press_forces = true;
    const auto six = link_numbers<6>(press_forces_W_N, "press_forces_W_N", "two forces");
    std::transform(six.begin(), six.begin() + 3, patch.press_forces_W_N[0].begin(), narrowed);
    std::transform(six.begin() + 3, six.end(), patch.press_forces_W_N[1].begin(), narrowed);
  }
  send(self, patch, "the patch");
}

void bind_messages(py::module_& module) {
  py::class_<ToolState>(module, "ToolState", "Where the tool is, from the servo. Frame W.")
      .def_readonly("sequence", &ToolState::sequence)
      .def_readonly("servo_time_ns", &ToolState::servo_time_ns, "The servo's clock.")
      .def_property_readonly(
          "position_W_m", [](const ToolState& self) { return tuple_of(self.position_W_m); },
          "[m] (x, y, z)")
      .def_property_readonly(
          "velocity_W_m_per_s",
          [](const ToolState& self) { return tuple_of(self.velocity_W_m_per_s); },
          "[m/s] (x, y, z)")
      .def_readonly("has_orientation", &ToolState::has_orientation,
                    "Else the identity, and no angular velocity.")
      .def_readonly("has_buttons", &ToolState::has_buttons, "Else none is pressed.")
      .def_property_readonly(
          "orientation_WT", [](const ToolState& self) { return tuple_of(self.orientation_WT); },
          "(w, x, y, z) of the rotation from the tool's frame T to W")
      .def_property_readonly(
          "angular_velocity_W_rad_per_s",
          [](const ToolState& self) { return tuple_of(self.angular_velocity_W_rad_per_s); },
          "[rad/s] (x, y, z)")
      .def_readonly("buttons", &ToolState::buttons, "Bit i: the device's button i is pressed.")
      .def("__repr__", [](const ToolState& self) {
        return py::str("ToolState(sequence={}, position_W_m={})")
            .format(self.sequence, tuple_of(self.position_W_m));
      });
  py::class_<Query>(module, "Query", "The servo asks for the force at a place. Frame W.")
      .def_readonly("query_id", &Query::query_id)
      .def_readonly("servo_time_ns", &Query::servo_time_ns)
      .def_property_readonly(
          "position_W_m", [](const Query& self) { return tuple_of(self.position_W_m); },
          "[m] (x, y, z)");
  using News = SimulatorEndpoint::News;
  py::class_<News>(module, "News", "What receive() found; all empty after a time-out.")
      .def_readonly("tool_state", &News::tool_state,
                    "The newest ToolState, if it is new since the last call; else None.")
      .def_readonly("new_session", &News::new_session,
                    "Another run of a servo began: forget what belongs to the last one.")
      .def_readonly("servo_ended", &News::servo_ended, "The servo said goodbye.");
}

void add_answers(py::class_<SimulatorLink>& type) {
  type.def("answer", &answer, py::arg("request"), py::arg("force_W_N"), py::arg("in_contact"),
           py::arg("converged"), py::arg("stiffness_W_N_per_m") = py::none(),
           py::arg("position_W_m") = py::none(), py::arg("contact_point_W_m") = py::none(),
           py::arg("contact_epoch") = 0, py::arg("relative_residual") = 0.0,
           py::arg("solve_time_s") = 0.0, py::arg("torque_W_Nm") = py::none(),
           py::arg("orientation_WT") = py::none(),
           py::arg("rotational_stiffness_W_Nm_per_rad") = py::none(),
           py::arg("torque_gradient_W_N") = py::none(),
           R"(Answers a ToolState or a Query. Without a servo it does nothing.

force_W_N: [N] of the object on the tool, three numbers, frame W. in_contact: the tool touches the
object; say False, with zero force, while it is free. converged: the solver reached its tolerance.
stiffness_W_N_per_m: dF/dP, 9 numbers row by row. position_W_m: where the force was computed; None:
the request's. contact_epoch: 0 before any contact, then a new number at every discontinuity.
contact_point_W_m: where the tool touched; None: the position. torque_W_Nm: [N m] on the tool about
position_W_m; a servo without a wrist does not get it. orientation_WT: (w, x, y, z) for which it was
computed; None: the request's. rotational_stiffness_W_Nm_per_rad, with a torque only:
d(torque)/d(theta), 9 numbers row by row; theta is the rotation vector in W by which the tool turns
on. torque_gradient_W_N, with a torque only: d(torque)/dP at a fixed orientation, 9 numbers row by
row; a servo that does not ask for it does not get it. Raises ValueError for what the servo would
refuse.)");
  type.def("show_surface", &show_surface, py::arg("tool_state"), py::arg("vertices_W_m"),
           py::arg("triangles"), py::arg("contact_epoch") = 0, py::arg("tool_radius_m") = 0.0,
           py::arg("tool_length_m") = 0.0, py::arg("stiffness_W_N_per_m") = py::none(),
           py::arg("press_forces_W_N") = py::none(), py::arg("tool_opening_rad") = 0.0,
           R"(Sends the part of the surface that a tool in the air may touch next. Optional.

vertices_W_m: at most 19 times three numbers. triangles: at most 27 times three vertex numbers,
counterclockwise seen from outside. stiffness_W_N_per_m: xx, yy, zz, xy, xz, yz of a tool that has
just touched. press_forces_W_N, in place of it for a tool that slides: shape (2, 3), 1 and 2 mm
deep. Raises ValueError for what the servo would refuse.)");
}

}  // namespace

void bind_simulator_link(py::module_& module) {
  error_type<link::LinkError>(module, "LinkError", PyExc_OSError,
                              "A link that can't be set up. The text says what to do.");
  bind_messages(module);
  py::class_<SimulatorLink> type(module, "SimulatorLink",
                                 R"(The simulator's end of the link: serves one servo at a time.

    with forcegrid.SimulatorLink("127.0.0.1", 24870) as link:
        while True:
            news = link.receive(timeout_s=1 / 30)
            if news.tool_state:
                link.answer(news.tool_state, force, in_contact=True, converged=True)

Units are SI; vectors are (x, y, z) in the workspace frame W: x toward the operator, y to the
operator's right, z up. Threads: calls wait for each other.)");
  type.def(py::init<const std::string&, int, const std::vector<std::string>&, double>(),
           py::arg("host") = "127.0.0.1", py::arg("port") = 24870,
           py::arg("key_files") = std::vector<std::string>{}, py::arg("silence_s") = 2.0,
           R"(Listens at host:port; port 0 takes a free one.

key_files: files of `forcegrid keygen`; without one only addresses of this machine. silence_s: after
which another servo may take the link. Raises LinkError saying what to do.)")
      .def_property_readonly("port", [](SimulatorLink& self) { return self.endpoint().port(); })
      .def_property_readonly(
          "servo_alive",
          [](SimulatorLink& self) {
            return self.guard.alone([&] { return self.endpoint().servo_alive(); });
          },
          "Whether a servo holds the link and was heard within silence_s.")
      .def_property_readonly(
          "dropped",
          [](SimulatorLink& self) {
            return dropped_of(self.guard.alone([&] { return self.endpoint().statistics(); }));
          },
          "Datagrams that were dropped, by reason: dict.")
      .def("receive", &receive, py::arg("timeout_s"),
           "Takes in all that has arrived, waits up to timeout_s [s] if there is nothing, without "
           "the GIL. Returns News.")
      .def(
          "next_query",
          [](SimulatorLink& self) {
            return self.guard.alone([&] { return self.endpoint().next_query(); });
          },
          "The oldest waiting Query of the current session, or None.")
      .def(
          "next_tool_state",
          [](SimulatorLink& self) {
            return self.guard.alone([&] { return self.endpoint().next_tool_state(); });
          },
          "The oldest ToolState that was not given here, or None: the tool's whole path.")
      .def("close", &SimulatorLink::close, "Says goodbye to the servo, if there is one.")
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](SimulatorLink& self, const py::args&) { self.close(); });
  add_answers(type);
}

}  // namespace forcegrid::python
