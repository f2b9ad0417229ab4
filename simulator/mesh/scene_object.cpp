// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/scene_object.h"

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <optional>
#include <utility>

#include "rt/checkpoint.h"
#include "rt/vectors.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/gmsh_file.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/mesh_file.h"
#include "simulator/mesh/mesh_object.h"
#include "simulator/mesh/missing_part.h"
#include "simulator/mesh/organ_surface.h"
#include "simulator/mesh/tetrahedra.h"
#include "text/nearest_name.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using text::kAboveZero;
using text::NumberRange;
using text::TomlTable;

constexpr NumberRange kSize_m{1e-3, 2.0, "a length in metres from 0.001 to 2"};
constexpr NumberRange kPlace_m{-2.0, 2.0, "a coordinate in metres from -2 to 2"};
constexpr NumberRange kStiffness_N_per_m{1e-3, 1e6, "a stiffness in N/m from 0.001 to 1e6"};
constexpr NumberRange kFactor{1e-3, 1e3, "a factor from 0.001 to 1000"};
constexpr NumberRange kHome_N_per_m{0.0, 1e6, "a stiffness in N/m from 0 to 1e6"};
constexpr NumberRange kBend_m{0.0, 1.0, "a length in metres from 0 to 1"};
constexpr NumberRange kPreStrain{0.0, 2.0, "a strain from 0 to 2"};
constexpr NumberRange kFixedBelow_m{0.0, 1.0, "a height in metres from 0 to 1"};
constexpr NumberRange kSpread{0.0, 0.99, "a fraction from 0 to 0.99"};
constexpr NumberRange kCubic{kAboveZero, 1e4, "a number above 0 and at most 1e4"};
constexpr NumberRange kMass_kg{1e-6, 1e3, "a mass in kg from 1e-6 to 1000"};
constexpr NumberRange kRetardation_s{0.0, 10.0, "a time in seconds from 0 to 10"};
constexpr NumberRange kMassDamping_per_s{0.0, 1e4, "a rate in 1/s from 0 to 10000"};
constexpr NumberRange kExponent{0.01, 30.0, "a number from 0.01 to 30"};
constexpr NumberRange kYoungsModulus_Pa{1e-3, 1e13, "a modulus in Pa from 0.001 to 1e13"};
constexpr NumberRange kPoissonsRatio{
    -0.99, 0.4999,
    "a ratio from -0.99 to 0.4999; linear tetrahedra cannot keep their volume exactly"};
constexpr NumberRange kDensity_kg_per_m3{1.0, 3e4, "a density in kg/m^3 from 1 to 30000"};
// From the softest brain to cortical bone, and from an inflated lung to tooth enamel.
// Sources: Budday et al., Arch. Comput. Methods Eng. 27 (2020), table 1; Rho, Kuhn-Spearing and
// Zioupos, Med. Eng. Phys. 20 (1998); Duck, Physical Properties of Tissue (1990), chapter 5.
constexpr double kSoftestTissue_Pa = 100.0;
constexpr double kStiffestTissue_Pa = 3e10;
constexpr double kLightestTissue_kg_per_m3 = 200.0;
constexpr double kHeaviestTissue_kg_per_m3 = 3100.0;
constexpr double kReadingPart = 0.5;  // of the time that an object of a file takes
constexpr std::int64_t kMaxSeed = 1'000'000'000;

const std::vector<std::string> kShapes{"block", "organ", "mesh"};
const std::vector<std::string> kLaws{"linear", "hardening", "exponential"};
const std::vector<std::string> kCommonKeys{"shape",
                                           "place_m",
                                           "stiffness_N_per_m",
                                           "random_spread",
                                           "seed",
                                           "law",
                                           "cubic_coefficient",
                                           "exponent",
                                           "mass_kg",
                                           "retardation_time_s",
                                           "mass_damping_per_s"};

std::string choice(const TomlTable& object, const char* key,
                   const std::vector<std::string>& known) {
  const std::string text = object.text(key);
  for (const std::string& each : known) {
    if (text == each) {
      return text;
    }
  }
  object.refuse(key, "'" + text + "' is unknown",
                "write one of: " + text::joined(known) + " (the nearest is " +
                    text::nearest_name(text, known) + ")");
}

SpringLaw read_law(const TomlTable& object) {
  const std::string law = choice(object, "law", kLaws);
  const auto only_for = [&object, &law](const char* key, const char* its_law) {
    if (law != its_law && object.has(key)) {
      object.refuse(key, "law \"" + law + "\" has none",
                    std::string("leave it out or write law = \"") + its_law + "\"");
    }
  };
  only_for("cubic_coefficient", "hardening");
  only_for("exponent", "exponential");
  SpringLaw result;
  if (law == "hardening") {
    result.cubic_coefficient = object.number("cubic_coefficient", kCubic);
  } else if (law == "exponential") {
    result.exponent = object.number("exponent", kExponent);
  }
  return result;
}

SpringMesh make_block(const TomlTable& object, const Eigen::Vector3d& place_W, Fineness fineness) {
  LatticeBlockOptions options;
  const std::vector<std::int64_t> count = object.integers("vertex_count", 3, 2, 1000);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    options.vertex_count[axis] = static_cast<int>(count[axis]);
    if (fineness == Fineness::kHalf) {
      options.vertex_count[axis] = std::max(2, (options.vertex_count[axis] + 1) / 2);
    }
  }
  options.size_m = rt::to_vector(object.axes("size_m", kSize_m));
  options.top_centre_W = place_W;
  options.stiffness_N_per_m = object.number("stiffness_N_per_m", kStiffness_N_per_m);
  options.diagonal_factor = object.number_or("diagonal_factor", kFactor, options.diagonal_factor);
  options.random_spread = object.number_or("random_spread", kSpread, 0.0);
  options.seed = static_cast<std::uint64_t>(object.integer_or("seed", 0, kMaxSeed, 1));
  options.law = read_law(object);
  return make_lattice_block(options);
}

SpringMesh make_organ(const TomlTable& object, const Eigen::Vector3d& place_W, Fineness fineness) {
  constexpr std::int64_t kMostVertices = 1'000'000;
  constexpr int kFewestVertices = 200;
  OrganOptions options;
  options.vertex_count =
      static_cast<int>(object.integer("vertex_count", kFewestVertices, kMostVertices));
  options.edge_count = static_cast<int>(object.integer("edge_count", 500, 6 * kMostVertices));
  options.semi_axes_m = rt::to_vector(object.axes("semi_axes_m", kSize_m));
  options.bend_m = object.number_or("bend_m", kBend_m, 0.0);
  options.top_W = place_W;
  options.stiffness_N_per_m = object.number("stiffness_N_per_m", kStiffness_N_per_m);
  options.strut_factor = object.number_or("strut_factor", kFactor, options.strut_factor);
  options.random_spread = object.number_or("random_spread", kSpread, 0.0);
  options.seed = static_cast<std::uint64_t>(object.integer_or("seed", 0, kMaxSeed, 1));
  options.pre_strain = object.number_or("pre_strain", kPreStrain, 0.0);
  options.home_stiffness_N_per_m = object.number_or("home_stiffness_N_per_m", kHome_N_per_m, 0.0);
  options.law = read_law(object);
  if (fineness == Fineness::kHalf) {
    const int vertices = options.vertex_count;
    options.vertex_count = std::max(kFewestVertices, vertices / 4);
    const double part = static_cast<double>(options.vertex_count) / vertices;
    options.edge_count = static_cast<int>(part * options.edge_count);
    options.home_stiffness_N_per_m /= part;
  }
  return make_organ_surface(options);
}

double unit_m(const TomlTable& object) {
  static const std::vector<std::pair<std::string, double>> units{
      {"m", 1.0}, {"cm", 1e-2}, {"mm", 1e-3}, {"inch", 0.0254}};
  std::vector<std::string> names;
  for (const auto& [name, metres] : units) {
    names.push_back(name);
  }
  const std::string unit = choice(object, "unit", names);
  return std::find_if(units.begin(), units.end(),
                      [&](const auto& each) { return each.first == unit; })
      ->second;
}

const std::vector<std::string> kMaterialKeys{"model", "youngs_modulus_Pa", "poissons_ratio",
                                             "density_kg_per_m3"};

bool has_elements(const TomlTable& object) {
  return object.has("material") || object.has("region");
}

ElementMaterial read_material(const TomlTable& table) {
  ElementMaterial material;
  material.model = *element_model(choice(table, "model", element_model_names()));
  material.youngs_modulus_Pa = table.number("youngs_modulus_Pa", kYoungsModulus_Pa);
  material.poissons_ratio = table.number("poissons_ratio", kPoissonsRatio);
  material.density_kg_per_m3 = table.number("density_kg_per_m3", kDensity_kg_per_m3);
  return material;
}

std::vector<TomlTable> region_tables(const TomlTable& object) {
  if (!object.has("region")) {
    return {};
  }
  return object.tables("region", [](const TomlTable&) {
    std::vector<std::string> keys = kMaterialKeys;
    keys.emplace_back("group");
    return keys;
  });
}

void read_materials(const TomlTable& object, MeshObjectOptions& options) {
  for (const char* key : {"stiffness_N_per_m", "law", "cubic_coefficient", "exponent",
                          "random_spread", "seed", "pre_strain", "mass_kg"}) {
    if (object.has(key)) {
      object.refuse(key, "an object with a material has none",
                    "leave it out: the material has stiffness and density");
    }
  }
  if (object.has("material")) {
    options.material = read_material(object.table("material", kMaterialKeys));
  }
  for (const TomlTable& table : region_tables(object)) {
    const std::string group = table.text("group");
    for (const RegionMaterial& other : options.region_materials) {
      if (other.region == group) {
        table.refuse("group", "'" + group + "' has a material already", "name each group once");
      }
    }
    options.region_materials.push_back({group, read_material(table)});
  }
}

void warn_of(const TomlTable& table, std::vector<std::string>& warnings) {
  const auto compare = [&](const char* key, double value, double least, double most,
                           const char* unit) {
    if (value < least || value > most) {
      warnings.push_back(table.file() + ":" + std::to_string(table.line_of(key)) + ": " + key +
                         " is " + text::number_text(value) + ", which no tissue has (" +
                         text::number_text(least) + " to " + text::number_text(most) + " " + unit +
                         "); check the unit");
    }
  };
  const ElementMaterial material = read_material(table);
  compare("youngs_modulus_Pa", material.youngs_modulus_Pa, kSoftestTissue_Pa, kStiffestTissue_Pa,
          "Pa");
  compare("density_kg_per_m3", material.density_kg_per_m3, kLightestTissue_kg_per_m3,
          kHeaviestTissue_kg_per_m3, "kg/m^3");
}

// Relative to the scene's file; an absolute path replaces the folder. What is made of the
// geometries in the source tree lies in its build folder.
std::string mesh_path(const TomlTable& object) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(object.file()).parent_path();
  const fs::path file = folder / object.text("file");
  std::error_code error;
  if (folder != FORCEGRID_SCENE_SOURCE_DIR || fs::exists(file, error)) {
    return file.string();
  }
  const fs::path made = fs::path(FORCEGRID_MADE_MESHES_DIR) / file.filename();
  if (!fs::exists(made, error)) {
    throw MissingPart("mesh file " + made.string() +
                      ": it is not there yet; 'make scenes' makes it with Gmsh");
  }
  return made.string();
}

double edge_factor(Fineness fineness) { return fineness == Fineness::kHalf ? 2.0 : 1.5; }

SpringMesh make_from_file(const TomlTable& object, const Eigen::Vector3d& place_W,
                          Fineness fineness) {
  if (fineness != Fineness::kAsWritten && !has_elements(object)) {
    object.refuse("file", "a mesh file of springs has no coarser form",
                  "choose a method or a scene that needs none");
  }
  const std::string file = mesh_path(object);
  MeshObjectOptions options;
  options.who = "mesh file " + file + ": ";
  options.unit_m = unit_m(object);
  options.top_W = place_W;
  options.fixed_below_m = object.number("fixed_below_m", kFixedBelow_m);
  options.home_stiffness_N_per_m = object.number_or("home_stiffness_N_per_m", kHome_N_per_m, 0.0);
  if (has_elements(object)) {
    read_materials(object, options);
  } else {
    options.stiffness_N_per_m = object.number("stiffness_N_per_m", kStiffness_N_per_m);
    options.random_spread = object.number_or("random_spread", kSpread, 0.0);
    options.seed = static_cast<std::uint64_t>(object.integer_or("seed", 0, kMaxSeed, 1));
    options.pre_strain = object.number_or("pre_strain", kPreStrain, 0.0);
    options.law = read_law(object);
  }
  MeshFile mesh;
  {
    const rt::PartOfWork part(0.0, kReadingPart);
    mesh = read_mesh_file(file);
  }
  if (fineness != Fineness::kAsWritten) {
    mesh = remeshed(mesh, edge_factor(fineness), options.who);
  }
  const rt::PartOfWork part(kReadingPart, 1.0);
  return make_mesh_object(mesh, options);
}

}  // namespace

std::vector<std::string> scene_object_keys(const TomlTable& object) {
  std::vector<std::string> keys = kCommonKeys;
  const std::string shape = choice(object, "shape", kShapes);
  if (shape == "block") {
    keys.insert(keys.end(), {"vertex_count", "size_m", "diagonal_factor"});
  } else if (shape == "mesh") {
    keys.insert(keys.end(), {"file", "unit", "fixed_below_m", "pre_strain",
                             "home_stiffness_N_per_m", "material", "region"});
  } else {
    keys.insert(keys.end(), {"vertex_count", "edge_count", "semi_axes_m", "bend_m", "strut_factor",
                             "pre_strain", "home_stiffness_N_per_m"});
  }
  return keys;
}

std::vector<std::string> material_warnings(const TomlTable& object) {
  std::vector<std::string> warnings;
  if (object.has("material")) {
    warn_of(object.table("material", kMaterialKeys), warnings);
  }
  for (const TomlTable& table : region_tables(object)) {
    warn_of(table, warnings);
  }
  return warnings;
}

std::optional<ObjectDynamics> read_dynamics(const TomlTable& object, const SpringMesh& mesh) {
  if (!mesh.tetrahedra.empty()) {
    const std::vector<double> masses_kg = element_masses_kg(mesh);
    return ObjectDynamics{
        .mass_kg = std::accumulate(masses_kg.begin(), masses_kg.end(), 0.0),
        .retardation_time_s = object.number_or("retardation_time_s", kRetardation_s, 0.0),
        .mass_damping_per_s = object.number_or("mass_damping_per_s", kMassDamping_per_s, 0.0)};
  }
  if (!object.has("mass_kg")) {
    for (const char* key : {"retardation_time_s", "mass_damping_per_s"}) {
      if (object.has(key)) {
        object.refuse(key, "damping has no effect without a mass",
                      "give the object a mass_kg or leave the damping out");
      }
    }
    return std::nullopt;
  }
  return ObjectDynamics{
      .mass_kg = object.number("mass_kg", kMass_kg),
      .retardation_time_s = object.number_or("retardation_time_s", kRetardation_s, 0.0),
      .mass_damping_per_s = object.number_or("mass_damping_per_s", kMassDamping_per_s, 0.0)};
}

SpringMesh make_scene_object(const TomlTable& object, const Eigen::Vector3d& origin_W,
                             Fineness fineness) {
  const Eigen::Vector3d place_W =
      origin_W + rt::to_vector(object.axes_or("place_m", kPlace_m, {0.0, 0.0, 0.0}));
  const std::string shape = choice(object, "shape", kShapes);
  if (shape == "mesh") {
    return make_from_file(object, place_W, fineness);
  }
  if (fineness == Fineness::kTwoThirds) {
    object.refuse("shape", "an object of springs has no such coarser form",
                  "choose a scene of finite elements");
  }
  return shape == "block" ? make_block(object, place_W, fineness)
                          : make_organ(object, place_W, fineness);
}

}  // namespace forcegrid::simulator
