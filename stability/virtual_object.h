// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "evaluation/objects/force_table.h"

namespace forcegrid::stability {

/// The object that the tool touches, as a perfect simulator would know it at every instant. Objects
/// with memory are advanced along the tool's path once per servo cycle.
/// Threads: one. Every run has a separate object.
class VirtualObject {
 public:
  using Value = evaluation::ForceTable::Value;

  /// State of the contact as reported by the simulator.
  struct Contact {
    bool in_contact = true;
    std::uint32_t epoch = 1;  ///< a new number at every discontinuity
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
  };

  virtual ~VirtualObject() = default;

  /// Advances the object to `time_s` [s] with the tool at `position_W` [m]; times must not
  /// decrease.
  virtual void advance(double time_s, const Eigen::Vector3d& position_W) {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
  }

  /// Returns force [N] and stiffness [N/m] for a tool at `position_W` [m] in the object's present
  /// state.
  virtual Value at(const Eigen::Vector3d& position_W) const = 0;

  virtual Contact contact() const = 0;

  /// [m] Where a tool in the air at `position_W` [m] touches within `within_s` [s] if it keeps the
  /// velocity `velocity_W` [m/s]; nothing if it does not, or if the simulator can't tell.
  virtual std::optional<Eigen::Vector3d> expected_touch_W(const Eigen::Vector3d& position_W,
                                                          const Eigen::Vector3d& velocity_W,
                                                          double within_s) const {
    static_cast<void>(position_W);
    static_cast<void>(velocity_W);
    static_cast<void>(within_s);
    return std::nullopt;
  }

  /// Returns force [N] and stiffness [N/m] for a tool at rest at `position_W` [m] that has touched
  /// at `point_W` [m]: the answer to a request.
  virtual Value touched_at(const Eigen::Vector3d& point_W,
                           const Eigen::Vector3d& position_W) const {
    static_cast<void>(point_W);
    return at(position_W);
  }

  /// [N/m] Normal stiffness at rest, which the charts vary.
  virtual double stiffness_N_per_m() const noexcept = 0;
};

/// F = -K (x - c): the spring of the theory of sampled springs.
class LinearObject final : public VirtualObject {
 public:
  LinearObject(double stiffness_N_per_m, const Eigen::Vector3d& contact_point_W)
      : stiffness_N_per_m_(stiffness_N_per_m), contact_point_W_(contact_point_W) {}

  Value at(const Eigen::Vector3d& position_W) const override {
    return {-stiffness_N_per_m_ * (position_W - contact_point_W_),
            -stiffness_N_per_m_ * Eigen::Matrix3d::Identity()};
  }
  Contact contact() const override { return {true, 1, contact_point_W_}; }
  double stiffness_N_per_m() const noexcept override { return stiffness_N_per_m_; }

 private:
  double stiffness_N_per_m_;
  Eigen::Vector3d contact_point_W_;
};

/// A deformable object that the tool holds, from its force table, scaled to a given stiffness:
///
///   F = K / K_table F_table(clamp(x - c))
///
/// Outside the table the force is that at its edge. `table` must outlive the object.
class TableObject final : public VirtualObject {
 public:
  TableObject(const evaluation::ForceTable& table, double stiffness_N_per_m,
              const Eigen::Vector3d& contact_point_W)
      : table_(table),
        factor_(stiffness_N_per_m / normal_stiffness_N_per_m(table)),
        stiffness_N_per_m_(stiffness_N_per_m),
        contact_point_W_(contact_point_W) {}

  /// [N/m] -dF_z/dz at rest.
  static double normal_stiffness_N_per_m(const evaluation::ForceTable& table) {
    return -table.at(Eigen::Vector3d::Zero()).stiffness_W(2, 2);
  }

  Value at(const Eigen::Vector3d& position_W) const override {
    const Value value = table_.at(table_.clamped(position_W - contact_point_W_));
    return {factor_ * value.force_W, factor_ * value.stiffness_W};
  }
  Contact contact() const override { return {true, 1, contact_point_W_}; }
  double stiffness_N_per_m() const noexcept override { return stiffness_N_per_m_; }

 private:
  const evaluation::ForceTable& table_;
  double factor_;
  double stiffness_N_per_m_;
  Eigen::Vector3d contact_point_W_;
};

}  // namespace forcegrid::stability
