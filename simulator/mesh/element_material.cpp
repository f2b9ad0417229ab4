// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/element_material.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct ModelName {
  ElementModel model;
  const char* name;
};
constexpr std::array<ModelName, 3> kModelNames{{{ElementModel::kCorotated, "corotated"},
                                                {ElementModel::kStVenantKirchhoff, "stvk"},
                                                {ElementModel::kNeoHookean, "neo_hookean"}}};

struct NeoHookean {
  explicit NeoHookean(const ElementMaterial& material)
      : m_Pa(4.0 / 3.0 * material.mu_Pa()),
        l_Pa(material.lambda_Pa() + 5.0 / 6.0 * material.mu_Pa()),
        a(1.0 + 0.75 * m_Pa / l_Pa) {}
  double m_Pa;
  double l_Pa;
  double a;
};

// dJ/dF.
Matrix3d cofactors(const Matrix3d& f) {
  Matrix3d result;
  result.col(0) = f.col(1).cross(f.col(2));
  result.col(1) = f.col(2).cross(f.col(0));
  result.col(2) = f.col(0).cross(f.col(1));
  return result;
}

Matrix3d corotated_slope(const ElementMaterial& material, const Matrix3d& f, const Matrix3d& by) {
  const Matrix3d r = nearest_rotation(f);
  const Matrix3d s = r.transpose() * f;
  const Matrix3d turned = r.transpose() * by;
  const Vector3d twist(turned(2, 1) - turned(1, 2), turned(0, 2) - turned(2, 0),
                       turned(1, 0) - turned(0, 1));
  const Vector3d w = (s.trace() * Matrix3d::Identity() - s).inverse() * twist;
  Matrix3d cross;
  cross << 0.0, -w.z(), w.y(), w.z(), 0.0, -w.x(), -w.y(), w.x(), 0.0;
  const double mu = material.mu_Pa();
  const double lambda = material.lambda_Pa();
  return 2.0 * mu * by + lambda * turned.trace() * r +
         (lambda * (s.trace() - 3.0) - 2.0 * mu) * r * cross;
}

Matrix3d stvk_slope(const ElementMaterial& material, const Matrix3d& f, const Matrix3d& by) {
  const Matrix3d g = 0.5 * (f.transpose() * f - Matrix3d::Identity());
  const Matrix3d dg = 0.5 * (by.transpose() * f + f.transpose() * by);
  const auto stress = [&material](const Matrix3d& strain) -> Matrix3d {
    return 2.0 * material.mu_Pa() * strain +
           material.lambda_Pa() * strain.trace() * Matrix3d::Identity();
  };
  return by * stress(g) + f * stress(dg);
}

Matrix3d neo_hookean_slope(const ElementMaterial& material, const Matrix3d& f, const Matrix3d& by) {
  const NeoHookean law(material);
  const double root = f.squaredNorm() + 1.0;
  const Matrix3d cofactor = cofactors(f);
  Matrix3d turn;  // of the cofactors
  turn.col(0) = by.col(1).cross(f.col(2)) + f.col(1).cross(by.col(2));
  turn.col(1) = by.col(2).cross(f.col(0)) + f.col(2).cross(by.col(0));
  turn.col(2) = by.col(0).cross(f.col(1)) + f.col(0).cross(by.col(1));
  return law.m_Pa * (1.0 - 1.0 / root) * by +
         2.0 * law.m_Pa / (root * root) * f.cwiseProduct(by).sum() * f +
         law.l_Pa * cofactor.cwiseProduct(by).sum() * cofactor +
         law.l_Pa * (f.determinant() - law.a) * turn;
}

}  // namespace

const char* name_of(ElementModel model) noexcept {
  for (const ModelName& each : kModelNames) {
    if (each.model == model) {
      return each.name;
    }
  }
  return "";
}

std::optional<ElementModel> element_model(std::string_view name) noexcept {
  for (const ModelName& each : kModelNames) {
    if (each.name == name) {
      return each.model;
    }
  }
  return std::nullopt;
}

const std::vector<std::string>& element_model_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> result;
    for (const ModelName& each : kModelNames) {
      result.emplace_back(each.name);
    }
    return result;
  }();
  return names;
}

Matrix3d nearest_rotation(const Matrix3d& f) noexcept {
  const Eigen::JacobiSVD<Matrix3d> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3d& u = svd.matrixU();
  const Matrix3d& v = svd.matrixV();
  // Of an inverted element the direction of the smallest stretch is turned around.
  const Vector3d sign(1.0, 1.0, (u * v.transpose()).determinant() < 0.0 ? -1.0 : 1.0);
  return u * sign.asDiagonal() * v.transpose();
}

double strain_energy_J_per_m3(const ElementMaterial& material, const Matrix3d& f) noexcept {
  const double mu = material.mu_Pa();
  const double lambda = material.lambda_Pa();
  if (material.model == ElementModel::kCorotated) {
    const Matrix3d r = nearest_rotation(f);
    const double stretch = (r.transpose() * f).trace() - 3.0;
    return mu * (f - r).squaredNorm() + 0.5 * lambda * stretch * stretch;
  }
  if (material.model == ElementModel::kStVenantKirchhoff) {
    const Matrix3d g = 0.5 * (f.transpose() * f - Matrix3d::Identity());
    return mu * g.squaredNorm() + 0.5 * lambda * g.trace() * g.trace();
  }
  const NeoHookean law(material);
  const double from_a = f.determinant() - law.a;
  return 0.5 * law.m_Pa * (f.squaredNorm() - 3.0) + 0.5 * law.l_Pa * from_a * from_a -
         0.5 * law.m_Pa * std::log(f.squaredNorm() + 1.0);
}

Matrix3d stress_Pa(const ElementMaterial& material, const Matrix3d& f) noexcept {
  const double mu = material.mu_Pa();
  const double lambda = material.lambda_Pa();
  if (material.model == ElementModel::kCorotated) {
    const Matrix3d r = nearest_rotation(f);
    return 2.0 * mu * (f - r) + lambda * ((r.transpose() * f).trace() - 3.0) * r;
  }
  if (material.model == ElementModel::kStVenantKirchhoff) {
    const Matrix3d g = 0.5 * (f.transpose() * f - Matrix3d::Identity());
    return f * (2.0 * mu * g + lambda * g.trace() * Matrix3d::Identity());
  }
  const NeoHookean law(material);
  return law.m_Pa * (1.0 - 1.0 / (f.squaredNorm() + 1.0)) * f +
         law.l_Pa * (f.determinant() - law.a) * cofactors(f);
}

Eigen::Matrix<double, 9, 9> stress_slope_Pa(const ElementMaterial& material,
                                            const Matrix3d& f) noexcept {
  Eigen::Matrix<double, 9, 9> slope;
  for (int entry = 0; entry < 9; ++entry) {
    Matrix3d by = Matrix3d::Zero();
    by(entry % 3, entry / 3) = 1.0;
    const Matrix3d change =
        material.model == ElementModel::kCorotated           ? corotated_slope(material, f, by)
        : material.model == ElementModel::kStVenantKirchhoff ? stvk_slope(material, f, by)
                                                             : neo_hookean_slope(material, f, by);
    slope.col(entry) = change.reshaped();
  }
  return slope;
}

}  // namespace forcegrid::simulator
