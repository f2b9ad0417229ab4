// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <string_view>

#include "tests/fuzz/fuzz_targets.h"
#include "view/access.h"
#include "view/messages.h"

namespace forcegrid::fuzz {

void view_command(Input input) {
  const std::string_view text(reinterpret_cast<const char*>(input.data()), input.size());
  if (const auto command = view::parse_command(text)) {
    const auto again = view::parse_command(view::command_json(*command, command->id));
    require(again && again->what == command->what && again->id == command->id &&
                again->pause == command->pause && again->target_W_m == command->target_W_m &&
                again->cycle == command->cycle,
            "the run is told what the page said");
    if (command->target_W_m) {
      for (const double coordinate_m : *command->target_W_m) {
        require(std::abs(coordinate_m) <= 10.0, "a target is finite and near");
      }
    }
  }
  // The same bytes as a request's target, Host and Origin.
  require(view::query_value(text, "token").size() <= text.size(), "a value is a part of the query");
  if (view::host_is_right(text, {"127.0.0.1", 8080})) {
    require(text.ends_with(":8080") && text.size() <= 14, "a host is one of four");
  }
  require(!view::origin_is_right(text, "127.0.0.1:8080") || text.size() == 21,
          "an origin is the server's own");
}

}  // namespace forcegrid::fuzz
