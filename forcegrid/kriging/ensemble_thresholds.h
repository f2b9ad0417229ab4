// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace forcegrid::kriging {

/// The numbers that decide which candidate of an ensemble is rendered.
///
/// A candidate's score [N^2] is the squared error of its predictions, averaged over samples; its
/// rating is the score times a weight, and the least rating wins. docs/kriging.md, "How the
/// ensemble chooses", has the rules that use these numbers; its table "Thresholds" describes each
/// source. The brackets name the source: [study] the prototype study behind the kriging methods,
/// [traces] checked on recorded traces, [jelly] chosen on the scene `jelly` and a moving block,
/// [choice] no recorded comparison.
struct EnsembleThresholds {
  // Who is awake (WakeRule). [wake] chosen on seeds 2 and 3 of the chart's motions; docs/kriging.md
  // has the comparisons.

  /// [nats] Evidence against the rendered candidate that wakes everybody: if its predictions are
  /// right, at most once in exp(8) = 3,000 samples. [wake]
  double misfit_nats = 8.0;
  double good_enough_N = 1e-3;   ///< [N] smaller errors are as good as none; nobody takes over
                                 ///< from one whose score is below the square. [wake]
  double as_good_N = 0.7e-3;     ///< [N] more than the rendered one: nearly as good. [wake]
  bool everybody_awake = false;  ///< all the time, to compare with
  int awake_samples = 30;        ///< scored before all may sleep. [wake]
  int specialist_samples = 60;   ///< the same while a specialist is rendered. [wake]
  double regret = 1.02;          ///< squared error of one alone over that of the choice. [wake]
  double regret_kept = 0.98;     ///< of both, per sample: 50 samples. [wake]
  int path_lately = 60;          ///< samples after which the path counts as not needed. [wake]
  int hopeless_samples = 40;     ///< scored before single candidates may sleep. [wake]
  double hopeless = 16.0;        ///< squared error over the rendered one's, summed; and ... [wake]
  double hopeless_share = 0.5;   ///< ... in most samples, see WakeRule. [wake]
  int lately = 200;              ///< samples in which a rendered candidate is not forgotten. [wake]
  int unfinished_samples = 32;   ///< `unfinished` stays awake after such a sample. [choice]
  int walls_awake = 8;           ///< samples after a surprise, or unproven. [choice]
  double wall_plain_N = 0.1;     ///< [N] an error that no noise explains. [wake]
  /// It takes over at once where the rendered candidate's squared error is above this multiple of
  /// its score. [wake]
  double wall_unusual = 4.0;
  int walls_settle = 60;        ///< samples after it woke in which it may be mistaken. [wake]
  double places_learn_s = 0.4;  ///< [s] of a contact, which `places` takes; it remembers twice as
                                ///< many. [wake]
  int audition_samples = 12;    ///< of one audition. [wake]
  int contact_audition_samples = 4;  ///< of `memory` at the beginning of a contact. [wake]
  int longest_contact_pause = 4;     ///< contacts, of `places` and `memory`. [choice]
  int audition_pause = 24;  ///< samples before the first two, then twice as many each. [wake]
  int longest_audition_pause = 192;  ///< samples. [choice]
  /// [N] Deviation of the rendered candidate's force around the tool above which `memory` is asked.
  /// [wake]
  double unsure_N = 0.01;
  /// An auditioned candidate, `places` and `memory` begin with this multiple of the rendered one's
  /// score when they wake. [wake]
  double audition_handicap = 2.0;

  // Rating.

  /// Share of the old score that a sample leaves: an average over about 7 samples. [study]
  double score_kept = 0.85;
  /// Another candidate takes over when its rating is below this share of the rendered one's, so
  /// that the choice does not flicker. [traces]
  double hysteresis = 0.9;
  /// The same of one whose long score is above the rendered one's, with this weight. [wake]
  double lucky_weight = 4.0;
  /// Weight of candidates that are seldom needed: elsewhere a lucky run of theirs costs accuracy.
  /// [traces]
  double specialist_weight = 3.0;
  /// Weight of `places`, which is a little less accurate than others on a long contact. [choice]
  double places_weight = 2.0;
  /// [s] Time constant with which the step at a hand-over fades. [choice]
  double hand_over_s = 0.010;

  // Likelihood, which tells how much noise there is. [wake] all four, docs/kriging.md.

  double likelihood_kept = 0.95;    ///< of the sum of logarithms, per sample: 20 samples
  double most_unlikely_nats = 1.0;  ///< [nats] that one sample may speak against a candidate
  double more_likely_nats = 6.0;  ///< [nats] by which another must be more likely, a factor of 400,
  double nearly_as_good = 1.2;    ///< and its score at most this multiple

  // One-sided constraints, `walls`. The rules together are measured, the single numbers are not.

  /// A sample proves the constraint if the candidate's squared error is below this share of the
  /// best other's. [choice]
  double wall_proof = 0.1;
  /// A sample voids all proofs if the squared error is above this multiple of the best other's ...
  /// [choice]
  double wall_refuted = 4.0;
  double wall_refuted_N2 = 1e-3;     ///< ... plus this [N^2], (32 mN)^2. [choice]
  int wall_proofs = 2;               ///< proofs that make a constraint proven. [choice]
  double wall_proven_weight = 0.01;  ///< weight of the score with a proven constraint. [wake]
  double wall_calm_weight = 0.2;     ///< weight with a constraint, while calm. [choice]
  /// Calm: the surprise rate is below this. One surprise (0.15) leaves the candidate calm, a second
  /// within about 12 samples does not. [choice]
  double wall_calm = 0.17;
  /// A candidate that explains a surprise takes over at once if this share of its previous score
  /// was below the rendered one's. [wake]
  double wall_trusted = 0.09;
  /// Or, if that is `moved`, if its score is less than this share of the squared error that it
  /// explains. [wake]
  double wall_small_share = 0.01;

  // The same object, moved or weaker: `moved`.

  /// It claims a sample that leaves less than this of the object's strength ... [choice]
  double weaker_left = 0.8;
  /// ... and the next ones, if they leave more than this. [choice]
  double weaker_refined = 0.9;
  /// [variances of the noise per axis] Squared errors differ by as much through noise: nobody takes
  /// over from it for that, and it is not refuted. [wake]
  double noise_nuggets = 10.0;
  int moved_samples = 30;  ///< before it wakes with all others. [choice]

  // Candidates that know the tool's path.

  /// As score_kept, for the long score: an average over about 12 samples. [jelly]
  double long_score_kept = 0.92;
  std::uint64_t long_enough = 20;  ///< samples before the long score counts. [choice]
  double path_wrong_N2 = 1e-4;     ///< [N^2] (10 mN)^2: smaller errors are good enough. [jelly]
  /// A long score below this share of the best general candidate's is no lucky run. [jelly]
  double path_better_for_long = 0.8;

  // The beginning of a contact.

  double first_touch_s = 0.3;      ///< [s] the first instants of a contact. [choice]
  double first_touch_N = 0.1;      ///< [N] less force says little about the object. [choice]
  double first_touch_kept = 0.97;  ///< as score_kept, for first touches: 33 samples. [choice]
  int enough_answers = 4;          ///< before contact, for `places` to begin with. [choice]
  /// [m] Where `places` must be sure of the force, relative to the contact point, z being the
  /// surface's normal. [choice]
  Eigen::Vector3d probe_m{0.0, 0.0, 0.004};
  /// [N] Deviation there below which the place is known; error there by the simulator's stiffness
  /// above which it is not. [wake]
  double known_place_N = 0.10;
  /// `places` may have a score of at most this multiple of the best one, `memory` of its square
  /// times the rendered one. [choice]
  double no_worse = 2.0;

  // `memory`.

  /// Surprise rate above which the store may be out of date: 17 samples after a surprise. [choice]
  double outdated = 0.01;
  /// `memory` takes over where the rendered candidate's deviation is this many times its own ...
  /// [choice]
  double remembers_more = 3.0;
  double remembers_more_N = 0.01;  ///< ... and above this [N]. [choice]
  /// [N] Deviation 50 ms ahead of the tool below which `memory`, rendered, exchanges no samples.
  /// [wake]
  double remembered_N = 0.004;
};

}  // namespace forcegrid::kriging
