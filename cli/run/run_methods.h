// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "servo_loop/pair_exchange.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// Name of the method that solves the scene itself in the servo cycle.
inline constexpr char kDirect[] = "direct";

/// Renders one tool alone where a method over two tools cannot be rendered.
inline constexpr char kMethodOfOneTool[] = "auto";

/// Between the two loops of a program, for each method over two tools that they have, by its text.
using PairExchanges = std::map<std::string, servo::PairExchange>;

/// The methods of a run, each once: the rendered method first, then those that are evaluated along
/// the same path but not rendered.
class RunMethods {
 public:
  /// @param base options that each method of one tool gets before its own
  /// @param pairs of all devices of the program; it outlives this. Null: there is one device.
  /// @throws std::runtime_error for an unknown method, for `direct` if the scene can't be solved
  ///         within a cycle, or for a method over two tools with another number of devices.
  RunMethods(const RunOptions& options, const MethodOptions& base, PairExchanges* pairs = nullptr);

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
  [[nodiscard]] std::unique_ptr<ForceMethod> make_half(const MethodVariant& variant,
                                                       const RunOptions& options,
                                                       const MethodOptions& base) const;

  PairExchanges* pairs_;

  std::vector<std::unique_ptr<ForceMethod>> owned_;
  std::vector<ForceMethod*> methods_;
  std::vector<std::string> names_;
};

}  // namespace forcegrid::cli
