// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/core/force_method.h"

namespace forcegrid {

const char* to_string(EstimateStatus status) noexcept {
  switch (status) {
    case EstimateStatus::kOk:
      return "ok";
    case EstimateStatus::kPartlyKnown:
      return "partly known";
    case EstimateStatus::kUnknown:
      return "nothing known yet";
    case EstimateStatus::kOutside:
      return "outside the workspace";
    case EstimateStatus::kNotFinite:
      return "not finite";
  }
  return "invalid status";
}

const char* to_string(ChoiceReason reason) noexcept {
  switch (reason) {
    case ChoiceReason::kFirst:
      return "first";
    case ChoiceReason::kPredictedBetter:
      return "predicted better";
    case ChoiceReason::kFoundWall:
      return "found a wall";
    case ChoiceReason::kFirstTouches:
      return "best at first touches";
    case ChoiceReason::kRemembers:
      return "remembers";
    case ChoiceReason::kKnownPlace:
      return "knows the place";
    case ChoiceReason::kAskedBefore:
      return "asked before the touch";
    case ChoiceReason::kBothTools:
      return "knows both tools";
    case ChoiceReason::kOneTool:
      return "knows one tool";
    case ChoiceReason::kWeaker:
      return "found it weaker";
    case ChoiceReason::kAsGood:
      return "as good";
  }
  return "invalid reason";
}

}  // namespace forcegrid
