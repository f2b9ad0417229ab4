// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/rivals.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/rivals/coarse_mesh.h"
#include "simulator/rivals/condensation.h"
#include "simulator/rivals/greens_functions.h"
#include "simulator/rivals/penetration_depth.h"
#include "simulator/rivals/two_rates_method.h"
#include "simulator/rivals/unit_responses.h"

namespace forcegrid::simulator {
struct RivalTables::Tables {
  // A table and how long it took to make.
  template <typename Table>
  struct Timed {
    std::shared_ptr<const Table> table;
    double made_s = 0.0;

    template <typename Make>
    const Timed& once(const Make& make) {
      if (!table) {
        const auto start = std::chrono::steady_clock::now();
        table = make();
        made_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      }
      return *this;
    }
  };

  std::function<SpringMesh()> coarser;
  Timed<PenetrationTable> penetration;
  Timed<CoarseObject> coarse;
  Timed<UnitResponseTable> responses;
  Timed<GreensTable> greens;
  Timed<CondensedTable> condensed;
};

const std::vector<Rival>& rivals() {
  static const std::vector<Rival> all{
      {"penetration-depth", "[4] Basdogan et al. 1998", "surface at rest, one stiffness",
       "small pushes along the normal of an object that is equally stiff everywhere"},
      {"coarse-mesh", "[8] Burdea et al. 1998", "model, a coarser mesh of it, a cycle to solve it",
       "the coarse object is the fine one to the accuracy wanted"},
      {"unit-responses", "[9] Cotin et al. 1999", "model and contact point before the run",
       "contact points are known and displacements are along an axis, near the pre-computed "
       "length"},
      {"greens-functions", "[14] James and Pai 2001", "linear model before the run, memory",
       "the object is linear or moves little"},
      {"condensation", "[5] Bro-Nielsen and Cotin 1996",
       "linear model before the run, twice the memory",
       "as greens-functions; also where the shape of the surface is wanted"},
      {"two-rates", "[11] Debunne et al. 2001, in spirit",
       "model, a cycle to solve its near part, a second processor",
       "the model is at hand in the servo's computer"}};
  return all;
}

bool is_rival(const std::string& name) {
  return std::any_of(rivals().begin(), rivals().end(),
                     [&name](const Rival& rival) { return name == rival.name; });
}

RivalTables::RivalTables(std::function<SpringMesh()> coarser)
    : tables_(std::make_unique<Tables>()) {
  tables_->coarser = std::move(coarser);
}

RivalTables::~RivalTables() = default;
RivalTables::RivalTables(RivalTables&&) noexcept = default;
RivalTables& RivalTables::operator=(RivalTables&&) noexcept = default;

MadeRival RivalTables::make(const std::string& name, const SpringMesh& mesh,
                            double patch_radius_m) {
  const ContactReach reach{.patch_radius_m = patch_radius_m};
  if (name == "penetration-depth") {
    const auto& made =
        tables_->penetration.once([&] { return make_penetration_table(mesh, patch_radius_m); });
    return {std::make_unique<PenetrationDepthMethod>(made.table), made.made_s};
  }
  if (name == "coarse-mesh") {
    if (!tables_->coarser) {
      throw Error("coarse-mesh: the object comes without a coarser mesh; choose another method");
    }
    const auto& made = tables_->coarse.once([&] {
      return std::make_shared<const CoarseObject>(
          match_at_rest(mesh, tables_->coarser(), patch_radius_m));
    });
    return {std::make_unique<CoarseMeshMethod>(*made.table, false), made.made_s};
  }
  if (name == "unit-responses") {
    const auto& made = tables_->responses.once([&] {
      return make_unit_responses(mesh, {.patch_radius_m = patch_radius_m, .places_W = {}});
    });
    return {std::make_unique<UnitResponseMethod>(made.table), made.made_s};
  }
  if (name == "greens-functions") {
    const auto& made = tables_->greens.once([&] { return make_greens_table(mesh, reach); });
    return {std::make_unique<GreensFunctionsMethod>(made.table), made.made_s};
  }
  if (name == "condensation") {
    const auto& made = tables_->condensed.once([&] { return make_condensed_table(mesh, reach); });
    return {std::make_unique<CondensationMethod>(made.table), made.made_s};
  }
  if (name == "two-rates") {
    MadeRival made;
    made.method = std::make_unique<TwoRatesMethod>(
        mesh, TwoRatesMethodOptions{.patch_radius_m = patch_radius_m});
    return made;
  }
  std::string known;
  for (const Rival& rival : rivals()) {
    known += (known.empty() ? "" : ", ") + std::string(rival.name);
  }
  throw Error("unknown method '" + name + "' of an object's model; write one of: " + known);
}

}  // namespace forcegrid::simulator
