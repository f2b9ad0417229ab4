// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::tools {

/// What a udev rule can match of a device's node.
struct RuledNode {
  std::string subsystem;  ///< "hidraw", "usb"
  std::string kernel;     ///< the kernel's name: "hidraw3", "1-2"
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
};

/// A line of a rules file that lets every account write to a node.
struct OpenRule {
  std::string file;
  int line = 0;              ///< where it begins, from 1
  std::string assignment;    ///< 'MODE="0666"'
  bool final = false;        ///< with ":=": no later rule can change it
  bool before_ours = false;  ///< udev reads its file before 10-forcegrid.rules
};

/// Finds the rule that lets every account write to `node`: of those with MODE, the first final one,
/// else the last, as udev takes them; else the last that runs chmod. Files are read in the order of
/// their names; one in an earlier folder hides those of the same name in later ones. A line counts
/// if nothing in it contradicts the node: a condition that can't be judged here, such as another
/// attribute or a GOTO, is taken for true.
/// @param folders  in the order of precedence, /etc first.
/// Real-time: no. Threads: any.
std::optional<OpenRule> rule_that_opens(const RuledNode& node,
                                        const std::vector<std::string>& folders);

}  // namespace forcegrid::tools
