// SPDX-License-Identifier: Apache-2.0
#include "cli/common/option_values.h"

#include <algorithm>
#include <stdexcept>

#include "cli/common/options.h"
#include "device_emulator/fault_spec.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/pair_methods.h"

namespace forcegrid::cli {

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

Check method_check() {
  return Check{[](const std::string& input) {
                 if (input == "direct") {  // solved by the simulator, not a class in forcegrid/
                   return std::string();
                 }
                 try {
                   MethodOptions base;
                   base.grid.max_W.setConstant(0.1);
                   base.grid.cells.setConstant(10);
                   static_cast<void>(parse_pair_variant(input, base));
                   return std::string();
                 } catch (const std::invalid_argument& error) {
                   const std::string problem = error.what();
                   return problem.ends_with(known_pair_methods()) ? problem + ", direct" : problem;
                 }
               },
               "METHOD [KEY=VALUE...]"};
}

Check fault_check() {
  return Check{[](const std::string& input) {
                 try {
                   static_cast<void>(emulator::parse_fault(input));
                   return std::string();
                 } catch (const std::invalid_argument& error) {
                   return std::string(error.what());
                 }
               },
               "NAME[:KEY=VALUE,...]"};
}

void add_json(Command& command, JsonTarget& target) {
  command
      .add_optional_value(
          "--json",
          [&target](const std::optional<std::string>& file) {
            target.wanted = true;
            target.file = file.value_or(target.file);
          },
          "Summary as JSON, into FILE or to standard output")
      ->type_name("[FILE]")
      ->not_in_config();
}

const std::vector<std::string>& wrist_motions() {
  static const std::vector<std::string> names = {"still", "turn", "twist"};
  return names;
}

const std::vector<std::string>& motions() {
  static const std::vector<std::string> kNames = {"chirp", "lissajous", "random", "poke",
                                                  "hold",  "still",     "stroke"};
  return kNames;
}

const std::vector<std::string>& hands() {
  static const std::vector<std::string> kNames = {"firm", "light", "arm", "none"};
  return kNames;
}

const std::vector<std::string>& frame_orders() {
  static const std::vector<std::string> kNames = {"out-first", "in-first"};
  return kNames;
}

void add_key(Command& command, std::vector<std::string>& files, const std::string& description) {
  command.add_option("--key", files, description)->repeatable()->type_name("FILE");
}

Check motion_check() {
  return Check{[](const std::string& input) {
                 const bool known =
                     std::find(motions().begin(), motions().end(), input) != motions().end() ||
                     (input.starts_with("path:") && input.size() > std::string("path:").size());
                 return known ? std::string()
                              : "'" + input + "' is not a motion; use " + joined(motions()) +
                                    ", path:FILE";
               },
               "{" + joined(motions()) + ", path:FILE}"};
}

}  // namespace forcegrid::cli
