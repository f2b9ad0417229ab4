#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace forcegrid::kriging {

/// The numbers that decide which candidate of an ensemble is rendered. A candidate's score is the
/// squared error of its predictions [N^2], averaged over samples; its rating is the score times a
/// weight, and the least rating wins. Sources: docs/kriging.md, in the section named at each group;
/// "measured" means tuned there on the test objects, "chosen" means that accuracy does not depend
/// on it within a factor of two.
struct EnsembleThresholds {
  // Rating (section "The ensemble").

  /// Share of the old score that a new sample leaves: a memory of some six samples. Measured.
  double score_kept = 0.85;
  /// Another candidate takes over when its rating is below this share of the rendered one's.
  /// Measured: 1 makes noise choose.
  double hysteresis = 0.9;
  /// Weight of candidates that are needed seldom: elsewhere a lucky run of theirs costs accuracy.
  /// Measured.
  double specialist_weight = 3.0;
  /// Weight of `places`, which is a little worse than others on a long contact. Measured.
  double places_weight = 2.0;
  /// [s] Time constant of the fade at a hand-over: no step that a hand feels. Chosen.
  double hand_over_s = 0.010;

  // One-sided constraints, `walls` (section "One-sided constraints").

  /// A sample proves the constraint if the candidate's squared error is below this share of the
  /// best other's. Measured.
  double wall_proof = 0.1;
  /// A sample refutes all proofs if the squared error is above this multiple of the best other's,
  /// plus wall_refuted_N2. Measured.
  double wall_refuted = 4.0;
  double wall_refuted_N2 = 1e-3;     ///< [N^2] some 30 mN: errors below it refute nothing. Chosen.
  int wall_proofs = 2;               ///< proofs that make a constraint proven. Measured.
  double wall_proven_weight = 0.05;  ///< weight of the score with a proven constraint. Measured.
  double wall_calm_weight = 0.2;     ///< weight with a constraint while calm. Measured.
  /// Calm: the surprise rate is below this. One surprise alone, at share 0.15, leaves it calm; two
  /// within half a second (at 30 samples per second) do not.
  double wall_calm = 0.17;
  /// The candidate that explains a surprise takes over at once if this share of its score before
  /// was below the rendered one's. Measured.
  double wall_trusted = 0.1;

  // Candidates that know the tool's path (section "The ensemble", history).

  double long_score_kept = 0.92;   ///< as score_kept, for the long score: twelve samples. Measured.
  std::uint64_t long_enough = 20;  ///< samples before the long score says anything. Measured.
  double path_wrong_N2 = 1e-4;  ///< [N^2] (10 mN)^2: smaller errors are not worth the risk. Chosen.
  /// Long score below this share of the best general candidate's: no lucky run. Measured: an object
  /// with 0.1 kg of inertia is rendered by them 80 % of the time, one without 0 %.
  double path_better_for_long = 0.8;

  // The beginning of a contact (section "First touch").

  double first_touch_s = 0.3;      ///< [s] the first instants of a contact. Measured.
  double first_touch_N = 0.1;      ///< [N] less force tells nothing about the object. Chosen.
  double first_touch_kept = 0.97;  ///< as score_kept, for the record of first instants. Measured.
  int enough_answers = 4;          ///< before contact, for `places` to begin with. Measured.
  /// [m] Where `places` must be sure of the force, relative to the contact point, z being the
  /// surface's normal.
  Eigen::Vector3d probe_m{0.0, 0.0, 0.004};
  double known_place_N = 0.15;  ///< [N] deviation there up to which the place is known. Measured.
  double no_worse = 2.0;  ///< most that its record may be, times the best candidate's. Measured.

  // `memory` (section "The store").

  /// Surprise rate above which the store is out of date: half a second after the last surprise.
  double outdated = 0.01;
  /// `memory` takes over where the rendered candidate's deviation is this many times its own ...
  double remembers_more = 3.0;
  double remembers_more_N = 0.01;  ///< ... and at least this [N]. Both measured.
};

}  // namespace forcegrid::kriging
