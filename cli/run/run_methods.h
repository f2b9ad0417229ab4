// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// Name of the method that solves the scene itself in the servo cycle.
inline constexpr char kDirect[] = "direct";

/// The methods of a run, each once: the rendered method first, then those that are evaluated along
/// the same path but not rendered.
class RunMethods {
 public:
  /// @param base options that each method gets before its own
  /// @throws std::runtime_error for an unknown method, or for `direct` if the scene can't be solved
  ///         within a cycle.
  RunMethods(const RunOptions& options, const MethodOptions& base);

  /// In the order of names(). This object owns them.
  [[nodiscard]] const std::vector<ForceMethod*>& methods() const { return methods_; }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] const ForceMethod& rendered() const { return *methods_.front(); }

  /// [1/s] Rate of requests to the simulator. Only the rendered method may make requests; the
  /// evaluated methods get the samples along its path.
  /// @throws std::runtime_error if an evaluated method, the tool or the servo rate excludes
  ///         requests.
  [[nodiscard]] double requests_per_s(const RunOptions& options,
                                      const simulator::ToolOptions& tool) const;

 private:
  void add(const std::string& text, const RunOptions& options, const MethodOptions& base);

  std::vector<std::unique_ptr<ForceMethod>> owned_;
  std::vector<ForceMethod*> methods_;
  std::vector<std::string> names_;
};

}  // namespace forcegrid::cli
