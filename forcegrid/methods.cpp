#include "forcegrid/methods.h"

#include <stdexcept>

#include "forcegrid/hold_method.h"

namespace forcegrid {

const std::vector<std::string>& method_names() {
  static const std::vector<std::string> names = {"forcegrid", "hold"};
  return names;
}

std::unique_ptr<ForceMethod> make_force_method(const std::string& name,
                                               const ForcegridMethod::Options& grid) {
  if (name == "forcegrid") {
    return std::make_unique<ForcegridMethod>(grid);
  }
  if (name == "hold") {
    return std::make_unique<HoldMethod>();
  }
  std::string known;
  for (const std::string& each : method_names()) {
    known += (known.empty() ? "" : ", ") + each;
  }
  throw std::invalid_argument("method '" + name + "' is not known; choose one of: " + known);
}

}  // namespace forcegrid
