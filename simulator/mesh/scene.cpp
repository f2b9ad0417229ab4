// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/scene.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/gravity.h"
#include "simulator/mesh/missing_part.h"
#include "simulator/mesh/scene_object.h"
#include "simulator/mesh/scene_tool.h"
#include "simulator/mesh/vertex_masses.h"
#include "text/data_folder.h"
#include "text/file_kind.h"
#include "text/nearest_name.h"
#include "text/text.h"
#include "text/toml_table.h"

namespace forcegrid::simulator {
namespace {

using text::NumberRange;
using text::TomlTable;

constexpr NumberRange kGravity_m_per_s2{0.0, 100.0, "an acceleration in m/s^2 from 0 to 100"};
constexpr NumberRange kPatchRadius_m{1e-4, 0.5, "a radius in metres from 0.0001 to 0.5"};

const text::DataFolder& scene_folder() {
  static const text::DataFolder folder{"FORCEGRID_SCENE_PATH", "scenes",
                                       FORCEGRID_SCENE_SOURCE_DIR};
  return folder;
}

std::string find_scene(const std::string& name_or_file) {
  const std::string problem = scene_name_problem(name_or_file);
  if (!problem.empty()) {
    throw Error(problem);
  }
  if (!text::is_data_path(name_or_file)) {
    return text::find_data_file(scene_folder(), name_or_file);
  }
  const std::string why_not = text::why_no_file(name_or_file);
  if (!why_not.empty()) {
    throw Error("scene '" + name_or_file + "': " + why_not +
                "; write the path of a .toml file or one of: " + text::joined(scene_names()));
  }
  return name_or_file;
}

void give_masses(SpringMesh& object, const std::optional<ObjectDynamics>& dynamics,
                 double gravity_m_per_s2) {
  if (dynamics) {
    give_dynamics(object, *dynamics);
    if (gravity_m_per_s2 > 0.0) {
      settle_under_gravity(object, dynamics->mass_kg, gravity_m_per_s2);
    }
  } else if (gravity_m_per_s2 > 0.0) {
    throw Error("gravity_m_per_s2 needs masses; give every [[object]] a mass_kg");
  }
}

// A sticking tool would never hold anything if no vertex near it could move.
void check_patch(const TomlTable& root, const Scene& scene) {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < scene.mesh.rest_position_W.size(); ++i) {
    if (scene.mesh.fixed[i] == 0) {
      nearest_m = std::min(nearest_m, (scene.mesh.rest_position_W[i] - scene.mesh.top_W).norm());
    }
  }
  if (!scene.tool.slides() && nearest_m > scene.patch_radius_m) {
    root.refuse("patch_radius_m",
                "it is " + text::number_text(scene.patch_radius_m) +
                    ", and the nearest vertex that can move is " + text::number_text(nearest_m) +
                    " m from the top, so a tool would hold nothing there",
                "write more than that");
  }
}

const std::vector<std::string> kKeys{"description",      "note", "patch_radius_m",
                                     "gravity_m_per_s2", "tool", "object"};

Scene read_scene(const std::string& file, const Eigen::Vector3d& origin_W) {
  const toml::table parsed = text::read_toml_file(file);
  const TomlTable root(parsed, file, "", kKeys);
  Scene scene;
  scene.tool = read_scene_tool(root);
  scene.description = root.text("description");
  scene.note = root.text_or("note", "");
  scene.patch_radius_m = root.number_or("patch_radius_m", kPatchRadius_m, scene.patch_radius_m);
  const double gravity_m_per_s2 = root.number_or("gravity_m_per_s2", kGravity_m_per_s2, 0.0);
  const std::vector<TomlTable> objects = root.tables("object", scene_object_keys);
  const auto pieces = static_cast<double>(objects.size() + 1);  // the check is one
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const TomlTable& table = objects[i];
    const rt::PartOfWork part(static_cast<double>(i) / pieces, static_cast<double>(i + 1) / pieces);
    SpringMesh object = make_scene_object(table, origin_W);
    give_masses(object, read_dynamics(table, object), gravity_m_per_s2);
    const std::vector<std::string> warnings = material_warnings(table);
    scene.warnings.insert(scene.warnings.end(), warnings.begin(), warnings.end());
    if (!scene.mesh.rest_position_W.empty() &&
        scene.mesh.mass_kg.empty() != object.mass_kg.empty()) {
      throw Error("some objects have a mass_kg and others none; give it to every [[object]]");
    }
    append(object, scene.mesh);
  }
  const rt::PartOfWork last(1.0 - 1.0 / pieces, 1.0);
  check(scene.mesh);
  check_patch(root, scene);
  return scene;
}

SpringMesh read_coarser_mesh(const std::string& file, const Eigen::Vector3d& origin_W,
                             Fineness fineness) {
  const toml::table parsed = text::read_toml_file(file);
  const TomlTable root(parsed, file, "", kKeys);
  if (root.number_or("gravity_m_per_s2", kGravity_m_per_s2, 0.0) > 0.0) {
    root.refuse("gravity_m_per_s2", "an object under gravity has no coarser form",
                "choose a method or a scene that needs none");
  }
  SpringMesh mesh;
  for (const TomlTable& table : root.tables("object", scene_object_keys)) {
    append(make_scene_object(table, origin_W, fineness), mesh);
  }
  check(mesh);
  return mesh;
}

// Runs `read` on the scene's file; turns its errors into Error, with the file's name in front.
template <typename Read>
auto reading(const std::string& name_or_file, Read read) {
  const std::string file = find_scene(name_or_file);
  const auto with_name = [&file](const std::string& text) {
    return text.rfind(file, 0) == 0 ? text : file + ": " + text;
  };
  try {
    return read(file);
  } catch (const text::TomlError& problem) {
    throw Error(problem.what());
  } catch (const MissingPart& problem) {
    throw MissingPart(with_name(problem.what()));
  } catch (const Error& problem) {
    throw Error(with_name(problem.what()));
  }
}

}  // namespace

std::vector<std::string> scene_names() { return text::data_names(scene_folder()); }

std::string scene_name_problem(const std::string& name_or_file) {
  if (text::is_data_path(name_or_file) ||
      !text::find_data_file(scene_folder(), name_or_file).empty()) {
    return {};
  }
  const std::vector<std::string> known = scene_names();
  return "unknown scene '" + name_or_file + "'; write one of: " + text::joined(known) +
         " (the nearest is " + text::nearest_name(name_or_file, known) +
         "), or a file name that ends in .toml";
}

Scene make_scene(const std::string& name_or_file, const Eigen::Vector3d& origin_W) {
  Scene scene = reading(
      name_or_file, [&origin_W](const std::string& file) { return read_scene(file, origin_W); });
  scene.name = name_or_file;
  return scene;
}

SpringMesh make_coarser_mesh(const std::string& name_or_file, const Eigen::Vector3d& origin_W,
                             Fineness fineness) {
  return reading(name_or_file, [&](const std::string& file) {
    return read_coarser_mesh(file, origin_W, fineness);
  });
}

ToolOptions scene_tool(const std::string& name_or_file) {
  return reading(name_or_file, [](const std::string& file) {
    const toml::table parsed = text::read_toml_file(file);
    return read_scene_tool(TomlTable(parsed, file, "", kKeys));
  });
}

void refuse_sliding_tool(const std::string& scene, const ToolOptions& tool,
                         const std::string& purpose) {
  if (tool.slides()) {
    throw Error("scene " + scene + ": its tool slides, so the force depends on its path; " +
                purpose + " needs a scene whose [tool] is sticky or left out");
  }
  if (tool.turns) {
    throw Error("scene " + scene + ": its tool turns, so the force depends on its orientation; " +
                purpose + " needs a scene whose [tool] does not");
  }
}

}  // namespace forcegrid::simulator
