// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace forcegrid::kriging {

/// Whether the tool touches the object, since when and where; and where it is expected to touch.
/// Every contact, made or expected, has its own number. Positions of a contact are relative to its
/// origin: the contact point or, if that is not known, the position of the first sample. W is the
/// workspace frame, times are the servo's. Real-time: nothing allocates, locks or throws.
class ContactState {
 public:
  /// [s] An expectation lapses unless it is repeated within this time.
  static constexpr double kExpected_s = 0.1;
  /// [m] Contact points that differ by more than this belong to different contacts.
  static constexpr double kApart_m = 0.002;

  /// A contact begins. Its origin is unknown until set_origin().
  void made(double time_s) noexcept {
    ++number_;
    in_contact_ = true;
    known_ = true;
    has_origin_ = false;
    expected_s_ = kNever_s;
    begun_s_ = time_s;
  }
  void lost() noexcept {
    in_contact_ = false;
    known_ = true;
    expected_s_ = kNever_s;
  }
  /// A contact at `point_W` is expected, see ForceMethod::expect_contact().
  /// @returns true if it differs from the one expected before: it has a new number, and its origin
  ///   must be set.
  bool expect(double time_s, const Eigen::Vector3d& point_W) noexcept {
    const bool another = !expects(time_s) || (point_W - origin_W_).norm() > kApart_m;
    expected_s_ = time_s;
    number_ += another ? 1 : 0;
    return another;
  }
  void set_origin(const Eigen::Vector3d& point_W) noexcept {
    origin_W_ = point_W;
    has_origin_ = true;
  }

  bool in_contact() const noexcept { return in_contact_; }
  /// Whether the tool is in contact, at this point.
  bool is_at(const Eigen::Vector3d& point_W) const noexcept {
    return in_contact_ && has_origin_ && (point_W - origin_W_).norm() < kApart_m;
  }
  /// False until a contact has been made or lost for the first time.
  bool known() const noexcept { return known_; }
  bool expects(double time_s) const noexcept { return time_s - expected_s_ < kExpected_s; }
  bool has_origin() const noexcept { return has_origin_; }
  const Eigen::Vector3d& origin_W() const noexcept { return origin_W_; }
  std::uint64_t number() const noexcept { return number_; }
  double begun_s() const noexcept { return begun_s_; }

 private:
  static constexpr double kNever_s = -1e300;

  std::uint64_t number_ = 0;
  bool in_contact_ = false;
  bool known_ = false;
  bool has_origin_ = false;
  Eigen::Vector3d origin_W_ = Eigen::Vector3d::Zero();
  double begun_s_ = kNever_s;
  double expected_s_ = kNever_s;
};

}  // namespace forcegrid::kriging
