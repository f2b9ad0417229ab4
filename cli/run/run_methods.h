#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// The method that is the scene itself, solved in the servo cycle.
inline constexpr char kDirect[] = "direct";

/// The methods of a run, each once: the rendered one first, then those that are judged in its
/// shadow along the same path.
class RunMethods {
 public:
  /// @param base  what is told to each method before its own options
  /// @throws std::runtime_error for a method that is not known, or that is `direct` where the scene
  ///         can't be solved in a cycle.
  RunMethods(const RunOptions& options, const MethodOptions& base);

  /// In the order of names(); they live as long as this object.
  [[nodiscard]] const std::vector<ForceMethod*>& methods() const { return methods_; }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] const ForceMethod& rendered() const { return *methods_.front(); }

  /// How many requests a second go to the simulator [1/s]. Only the rendered method may ask: its
  /// shadows see what it sees along the path.
  /// @throws std::runtime_error where shadows, the tool or the servo rate exclude them.
  [[nodiscard]] double requests_per_s(const RunOptions& options,
                                      const simulator::ToolOptions& tool) const;

 private:
  void add(const std::string& text, const RunOptions& options, const MethodOptions& base);

  std::vector<std::unique_ptr<ForceMethod>> owned_;
  std::vector<ForceMethod*> methods_;
  std::vector<std::string> names_;
};

}  // namespace forcegrid::cli
