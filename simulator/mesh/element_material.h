// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace forcegrid::simulator {

/// How an element's energy grows with its deformation gradient F, see strain_energy_J_per_m3().
enum class ElementModel : std::uint8_t { kCorotated, kStVenantKirchhoff, kNeoHookean };

/// "corotated", "stvk" or "neo_hookean".
const char* name_of(ElementModel model) noexcept;
std::optional<ElementModel> element_model(std::string_view name) noexcept;
const std::vector<std::string>& element_model_names();

/// The material of linear tetrahedra.
struct ElementMaterial {
  ElementModel model = ElementModel::kCorotated;
  double youngs_modulus_Pa = 0.0;  ///< E > 0
  double poissons_ratio = 0.0;     ///< nu, above -1 and below 0.5
  double density_kg_per_m3 = 0.0;  ///< > 0
  /// tau >= 0 of Kelvin's and Voigt's damping, see SpringLaw.
  double retardation_time_s = 0.0;

  /// Lame's constants: mu = E / (2 (1 + nu)), lambda = E nu / ((1 + nu) (1 - 2 nu)).
  double mu_Pa() const noexcept { return youngs_modulus_Pa / (2.0 * (1.0 + poissons_ratio)); }
  double lambda_Pa() const noexcept {
    return youngs_modulus_Pa * poissons_ratio /
           ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio));
  }
};

/// Psi(F) of one material, with F the deformation gradient:
///
///   corotated     Psi = mu |F - R|^2 + lambda/2 (tr(R^T F) - 3)^2
///   stvk          Psi = mu G:G + lambda/2 (tr G)^2,   G = (F^T F - I) / 2
///   neo_hookean   Psi = m/2 (Ic - 3) + l/2 (J - a)^2 - m/2 log(Ic + 1)
///
/// R is the rotation nearest to F, det R = +1 also where the element is inverted. Ic = tr F^T F,
/// J = det F, m = 4 mu / 3, l = lambda + 5 mu / 6, a = 1 + 3 m / (4 l). m and l are such that the
/// material has mu and lambda at small strains; a, that it is without stress at rest.
///
/// Source: Smith, De Goes and Kim, Stable neo-Hookean flesh simulation, ACM TOG 37(2), 2018,
/// section 3; Kim and Eberle, Dynamic deformables, SIGGRAPH 2022 course, chapters 3 to 5.
///
/// These functions are the reference for the SIMD kernels, and serve what is not in a hurry.
double strain_energy_J_per_m3(const ElementMaterial& material, const Eigen::Matrix3d& f) noexcept;

/// [Pa] dPsi/dF, the first Piola-Kirchhoff stress.
Eigen::Matrix3d stress_Pa(const ElementMaterial& material, const Eigen::Matrix3d& f) noexcept;

/// [Pa] d2Psi/dF2, exact: not projected, so it may be indefinite. Row and column c + 3 d belong to
/// F(c, d).
Eigen::Matrix<double, 9, 9> stress_slope_Pa(const ElementMaterial& material,
                                            const Eigen::Matrix3d& f) noexcept;

/// The rotation nearest to F, by a singular value decomposition; det = +1.
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& f) noexcept;

}  // namespace forcegrid::simulator
