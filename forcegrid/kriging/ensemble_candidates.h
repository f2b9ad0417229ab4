// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/method_options.h"
#include "forcegrid/kriging/candidate_choice.h"
#include "forcegrid/kriging/ensemble_thresholds.h"
#include "forcegrid/kriging/history.h"

namespace forcegrid::kriging {

/// [s] Time constants of the path for history features: 0 to 2 are those of "slowly viscous", 3 to
/// 5 those of the other history candidates.
inline constexpr ToolHistory::TimeConstants kPathTimeConstants_s = {0.010, 0.100, 1.000,
                                                                    0.005, 0.030, 0.200};

enum class EnsembleKind {
  kKriging,  ///< `kriging-bank`
  kAuto,     ///< `auto`
};

/// The candidates of an ensemble:
///
///   name                               field                                      in
///   smooth, exact, noisy, very noisy   nuggets 1e-5, 1e-6, 1e-4, 1e-3 N^2;        both
///                                      two stiffnesses
///   kinks                              Matern 7/2 of 15 mm                        kriging-bank
///   slowly viscous                     history of 10, 100, 1000 ms, kf 0.03 N^2   kriging-bank
///   viscous, noisy viscous             history of 5, 30, 200 ms, kf 1 N^2;        both
///                                      nuggets 1e-5, 1e-4 N^2
///   walls                              UnilateralConstraintField                  both
///   memory                             StoreField                                 auto
///   unfinished                         LagField                                   auto
///   relaxing                           RelaxationField                            auto
///   places                             ContactIndexedField                        auto
///
/// @param options spacing_m and spacing_N; the candidates have their own nuggets and samples.
/// @param path of the tool, which must outlive the candidates, as must `thresholds`.
Candidates make_candidates(EnsembleKind kind, const MethodOptions& options,
                           const EnsembleThresholds& thresholds, const ToolHistory& path);

}  // namespace forcegrid::kriging
