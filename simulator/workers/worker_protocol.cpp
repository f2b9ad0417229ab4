// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker_protocol.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

using nlohmann::json;

json array_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::vector<double> numbers(const json& array, std::size_t count) {
  auto values = array.get<std::vector<double>>();
  if (values.size() != count) {
    throw std::invalid_argument("another count");
  }
  return values;
}

Eigen::Vector3d vector_of(const json& array) {
  const std::vector<double> values = numbers(array, 3);
  const Eigen::Vector3d vector(values[0], values[1], values[2]);
  if (!vector.allFinite()) {
    throw std::invalid_argument("not finite");
  }
  return vector;
}

/// JSON numbers convert to unsigned ones whatever their sign.
std::uint64_t count(const json& number) {
  if (!number.is_number_unsigned()) {
    throw std::invalid_argument("no count");
  }
  return number.get<std::uint64_t>();
}

std::uint32_t epoch(const json& number) {
  const std::uint64_t value = count(number);
  if (value > std::numeric_limits<std::uint32_t>::max()) {
    throw std::invalid_argument("no epoch");
  }
  return static_cast<std::uint32_t>(value);
}

// The name goes to terminals and files.
std::string printable(std::string name) {
  name.resize(std::min(name.size(), kMaxNameBytes));
  std::erase_if(name, [](char c) { return c <= ' ' || c > '~'; });
  return name;
}

bool nearly_equal(double one, double other) noexcept {
  constexpr double kTolerance = 1e-6;
  return std::abs(one - other) <= kTolerance * std::abs(one);
}

/// Calls `read` with the JSON object in `text`; nothing if there is none or `read` throws.
template <typename Read>
auto reading(const std::string& text, Read read) -> std::optional<decltype(read(json()))> {
  const json object = json::parse(text, nullptr, false);
  if (!object.is_object()) {
    return std::nullopt;
  }
  try {
    return read(object);
  } catch (const json::exception&) {
    return std::nullopt;
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

}  // namespace

ObjectDigest digest_of(const Scene& scene) {
  ObjectDigest digest;
  digest.scene = scene.name;
  digest.vertices = scene.mesh.rest_position_W.size();
  digest.springs = scene.mesh.springs.size();
  for (const Spring& spring : scene.mesh.springs) {
    digest.stiffness_sum_N_per_m += spring.stiffness_N_per_m;
    digest.length_sum_m += natural_length_m(scene.mesh, spring);
  }
  for (const Tetrahedron& element : scene.mesh.tetrahedra) {
    const ElementMaterial& material =
        scene.mesh.materials[static_cast<std::size_t>(element.material)];
    const double size_m = std::cbrt(element_shape(unstrained_W(scene.mesh), element).volume_m3);
    // Made so that two models or ratios give different numbers, too.
    digest.stiffness_sum_N_per_m +=
        material.youngs_modulus_Pa * size_m *
        (1.0 + static_cast<double>(material.model) + material.poissons_ratio);
    digest.length_sum_m += size_m;
  }
  digest.patch_radius_m = scene.patch_radius_m;
  return digest;
}

bool same_object(const ObjectDigest& one, const ObjectDigest& other) noexcept {
  return one.vertices == other.vertices && one.springs == other.springs &&
         nearly_equal(one.stiffness_sum_N_per_m, other.stiffness_sum_N_per_m) &&
         nearly_equal(one.length_sum_m, other.length_sum_m) &&
         nearly_equal(one.patch_radius_m, other.patch_radius_m);
}

std::string to_text(const WorkerHello& hello) {
  const ObjectDigest& object = hello.object;
  return json{{"hello", hello.name},
              {"scene", object.scene},
              {"vertices", object.vertices},
              {"springs", object.springs},
              {"stiffness_sum_N_per_m", object.stiffness_sum_N_per_m},
              {"length_sum_m", object.length_sum_m},
              {"patch_radius_m", object.patch_radius_m}}
      .dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string to_text(const NumberedJob& job) {
  return json{{"job", job.id},
              {"epoch", job.job.epoch},
              {"touching", job.job.touching},
              {"point_W_m", array_of(job.job.point_W)},
              {"position_W_m", array_of(job.job.position_W)}}
      .dump();
}

std::string to_text(const NumberedAnswer& numbered) {
  const StickyContact::Answer& answer = numbered.answer;
  json stiffness = json::array();
  for (int i = 0; i < 9; ++i) {
    stiffness.push_back(answer.equilibrium.stiffness_W(i / 3, i % 3));
  }
  return json{{"job", numbered.id},
              {"epoch", answer.epoch},
              {"in_contact", answer.in_contact},
              {"converged", answer.equilibrium.converged},
              {"position_W_m", array_of(answer.position_W)},
              {"force_W_N", array_of(answer.equilibrium.force_W)},
              {"stiffness_W_N_per_m", stiffness},
              {"relative_residual", answer.equilibrium.relative_residual},
              {"solve_time_s", answer.equilibrium.solve_time_s}}
      .dump();
}

std::string gave_up_text(std::uint64_t id) { return json{{"gave_up", id}}.dump(); }

std::string refusal_text(const std::string& reason) {
  return json{{"refused", reason}}.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string welcome_text(const SolverOptions& solver) {
  return json{{"welcome", true},
              {"relative_tolerance", solver.relative_tolerance},
              {"border_tolerance", solver.border_tolerance}}
      .dump();
}

std::optional<WorkerHello> read_hello(const std::string& text) {
  return reading(text, [](const json& object) {
    WorkerHello hello;
    hello.name = printable(object.at("hello"));
    hello.object = {object.at("scene"),          count(object.at("vertices")),
                    count(object.at("springs")), object.at("stiffness_sum_N_per_m"),
                    object.at("length_sum_m"),   object.at("patch_radius_m")};
    return hello;
  });
}

std::optional<NumberedJob> read_job(const std::string& text) {
  return reading(text, [](const json& object) {
    NumberedJob job;
    job.id = count(object.at("job"));
    job.job.epoch = epoch(object.at("epoch"));
    job.job.touching = object.at("touching");
    job.job.point_W = vector_of(object.at("point_W_m"));
    job.job.position_W = vector_of(object.at("position_W_m"));
    return job;
  });
}

std::optional<NumberedAnswer> read_answer(const std::string& text) {
  return reading(text, [](const json& object) {
    NumberedAnswer numbered;
    numbered.id = count(object.at("job"));
    StickyContact::Answer& answer = numbered.answer;
    answer.epoch = epoch(object.at("epoch"));
    answer.in_contact = object.at("in_contact");
    answer.position_W = vector_of(object.at("position_W_m"));
    answer.equilibrium.converged = object.at("converged");
    answer.equilibrium.force_W = vector_of(object.at("force_W_N"));
    const std::vector<double> stiffness = numbers(object.at("stiffness_W_N_per_m"), 9);
    for (int i = 0; i < 9; ++i) {
      answer.equilibrium.stiffness_W(i / 3, i % 3) = stiffness[static_cast<std::size_t>(i)];
    }
    answer.equilibrium.relative_residual = object.at("relative_residual");
    answer.equilibrium.solve_time_s = object.at("solve_time_s");
    if (!finite(answer.equilibrium)) {
      throw std::invalid_argument("not finite");
    }
    return numbered;
  });
}

std::optional<std::uint64_t> read_gave_up(const std::string& text) {
  return reading(text, [](const json& object) { return count(object.at("gave_up")); });
}

std::optional<std::string> read_refusal(const std::string& text) {
  return reading(text, [](const json& object) { return object.at("refused").get<std::string>(); });
}

std::optional<SolverOptions> read_welcome(const std::string& text, const SolverOptions& own) {
  return reading(text, [&own](const json& object) {
    SolverOptions solver = own;
    solver.relative_tolerance = object.at("relative_tolerance");
    solver.border_tolerance = object.at("border_tolerance");
    const auto fraction = [](double value) { return value >= 0.0 && value < 1.0; };
    if (!object.at("welcome").get<bool>() || !fraction(solver.relative_tolerance) ||
        solver.relative_tolerance == 0.0 || !fraction(solver.border_tolerance)) {
      throw std::invalid_argument("no welcome");
    }
    return solver;
  });
}

}  // namespace forcegrid::simulator
