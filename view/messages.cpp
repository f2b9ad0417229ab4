// SPDX-License-Identifier: Apache-2.0
#include "view/messages.h"

#include <algorithm>
#include <cmath>

#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

using nlohmann::json;
using What = PageCommand::What;

constexpr int kDeepest = 16;
constexpr double kFarthest_m = 10.0;
constexpr double kSlowest = 0.01;
constexpr double kFastest = 100.0;
constexpr double kLatest_s = 1e9;
constexpr std::uint64_t kMostId = std::uint64_t{1} << 53;  // exact as a number of a script
constexpr std::uint32_t kMostLines = 1024;
constexpr std::uint32_t kEpochModulus = 1U << 24U;  // a float keeps such a number exactly
constexpr std::size_t kLongestName = 256;           // [bytes] of a setting, or of its value

// Before the parser: what it makes of deep nesting is written out by recursion.
bool is_shallow(std::string_view text) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char letter = text[i];
    if (in_string) {
      if (letter == '\\') {
        ++i;
      } else if (letter == '"') {
        in_string = false;
      }
    } else if (letter == '"') {
      in_string = true;
    } else if (letter == '[' || letter == '{') {
      if (++depth > kDeepest) {
        return false;
      }
    } else if (letter == ']' || letter == '}') {
      --depth;
    }
  }
  return true;
}

std::optional<std::uint64_t> count_of(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number_unsigned() ||
      found->get<std::uint64_t>() > kMostId) {
    return std::nullopt;
  }
  return found->get<std::uint64_t>();
}

// False: there is no target, or it is none.
bool read_target(const json& object, PageCommand& command) {
  const auto target = object.find("target_W_m");
  if (target == object.end()) {
    return false;
  }
  if (target->is_null()) {
    return true;
  }
  if (!target->is_array() || target->size() != 3) {
    return false;
  }
  std::array<double, 3> position_W_m{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const json& number = (*target)[axis];
    if (!number.is_number() || !(std::abs(number.get<double>()) <= kFarthest_m)) {
      return false;
    }
    position_W_m[axis] = number.get<double>();
  }
  command.target_W_m = position_W_m;
  return true;
}

bool read_pause(const json& object, PageCommand& command) {
  const auto value = object.find("value");
  if (value == object.end() || !value->is_boolean()) {
    return false;
  }
  command.pause = value->get<bool>();
  return true;
}

bool read_shown(const json& object, PageCommand& command) {
  const auto cycle = count_of(object, "cycle");
  command.cycle = cycle.value_or(0);
  return cycle.has_value();
}

// Within low..high; a NaN is not.
bool read_between(const json& object, const char* key, double low, double high, double& number) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number()) {
    return false;
  }
  number = found->get<double>();
  return number >= low && number <= high;
}

bool read_play(const json& object, PageCommand& command) {
  const auto value = object.find("value");
  if (value == object.end() || !value->is_boolean()) {
    return false;
  }
  command.play = value->get<bool>();
  return read_between(object, "speed", kSlowest, kFastest, command.speed);
}

bool read_setting(const json& object, PageCommand& command) {
  const auto name = object.find("name");
  const auto value = object.find("value");
  if (name == object.end() || !name->is_string() ||
      name->get_ref<const std::string&>().size() > kLongestName || value == object.end()) {
    return false;
  }
  const bool is_sound =
      value->is_null() || (value->is_number() && std::isfinite(value->get<double>())) ||
      (value->is_string() && value->get_ref<const std::string&>().size() <= kLongestName);
  command.setting = name->get<std::string>();
  command.value = *value;
  return is_sound;
}

// An absent key leaves `number` as it is.
template <typename Number>
bool read_number(const json& object, const char* key, Number& number) {
  const auto found = object.find(key);
  if (found == object.end()) {
    return true;
  }
  if (!found->is_number() || !(std::abs(found->get<double>()) <= kFarthest_m * 1e3)) {
    return false;
  }
  number = found->get<Number>();
  return true;
}

bool read_flag(const json& object, const char* key, bool& flag) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_boolean()) {
    return false;
  }
  flag = found->get<bool>();
  return true;
}

// "method": null wants no slice.
bool read_slice(const json& object, PageCommand& command) {
  const auto method = object.find("method");
  if (method == object.end()) {
    return false;
  }
  if (method->is_null()) {
    return true;
  }
  SliceWish wish;
  const auto number = count_of(object, "method");
  const auto compared = object.find("compared");
  const bool is_compared = compared != object.end() && !compared->is_null();
  if (!number || (is_compared && !count_of(object, "compared"))) {
    return false;
  }
  wish.method = *number;
  if (is_compared) {
    wish.compared = *count_of(object, "compared");
  }
  command.slice = wish;
  return read_number(object, "normal", command.slice->normal) &&
         read_number(object, "size_m", command.slice->size_m) &&
         read_number(object, "points", command.slice->points);
}

}  // namespace

view_link::Bytes message_head(PageType type, std::uint8_t object) {
  return {static_cast<std::uint8_t>(type), object, 0, 0};
}

SharedBytes message_of(PageType type, std::uint8_t object, std::span<const std::uint8_t> payload) {
  auto bytes = std::make_shared<view_link::Bytes>();
  bytes->reserve(4 + payload.size());
  *bytes = message_head(type, object);
  view_link::append(*bytes, payload);
  return bytes;
}

std::array<std::uint8_t, kSampleBytes> sample_bytes(const view_link::FeedSample& sample,
                                                    double time_s) {
  std::array<float, kSampleBytes / sizeof(float)> number{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    number[axis] = narrow(sample.position_W_m[axis]);
    number[3 + axis] = narrow(sample.force_W_N[axis]);
    number[8 + axis] = narrow(sample.contact_point_W_m[axis]);
  }
  number[6] = narrow(time_s);
  number[7] = (sample.in_contact != 0 ? 1.0F : 0.0F) + (sample.requested != 0 ? 2.0F : 0.0F);
  number[11] = static_cast<float>(sample.contact_epoch % kEpochModulus);
  return std::bit_cast<std::array<std::uint8_t, kSampleBytes>>(number);
}

SharedBytes other_tool_message(std::size_t tool, const view_link::FeedCycle& cycle) {
  std::array<float, 7> number{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    number[axis] = narrow(cycle.position_W_m[axis]);
    number[3 + axis] = narrow(cycle.commanded_force_W_N[axis]);
  }
  number[6] = cycle.in_contact != 0 ? 1.0F : 0.0F;
  const auto bytes = std::bit_cast<std::array<std::uint8_t, sizeof number>>(number);
  return message_of(PageType::kOtherTool, static_cast<std::uint8_t>(tool), bytes);
}

bool arm_is_sound(std::span<const std::uint8_t> payload) {
  view_link::Reader reader(payload);
  const auto lines = reader.take<std::uint32_t>();
  if (lines > kMostLines) {
    return false;
  }
  for (std::uint32_t line = 0; line < lines && reader.ok(); ++line) {
    const auto points = reader.take<std::uint32_t>();
    if (points > reader.left() / (3 * sizeof(float))) {
      return false;
    }
    for (std::uint32_t point = 0; point < points; ++point) {
      const auto position_W_m = reader.take<std::array<float, 3>>();
      if (!std::all_of(position_W_m.begin(), position_W_m.end(),
                       [](float number) { return std::isfinite(number); })) {
        return false;
      }
    }
  }
  return reader.ok() && reader.left() == 0;
}

std::optional<json> parse_object(std::string_view text) {
  if (!is_shallow(text)) {
    return std::nullopt;
  }
  json value = json::parse(text.begin(), text.end(), nullptr, false);
  if (!value.is_object()) {
    return std::nullopt;
  }
  return value;
}

std::optional<PageCommand> parse_command(std::string_view text) {
  if (text.size() > kLargestPageText) {
    return std::nullopt;
  }
  const std::optional<json> object = parse_object(text);
  if (!object) {
    return std::nullopt;
  }
  PageCommand command;
  if (object->contains("id")) {
    const auto id = count_of(*object, "id");
    if (!id) {
      return std::nullopt;
    }
    command.id = *id;
  }
  const auto what = object->find("what");
  if (what == object->end() || !what->is_string()) {
    return std::nullopt;
  }
  const auto& name = what->get_ref<const std::string&>();
  bool complete = true;
  if (name == "stop") {
    command.what = What::kStop;
  } else if (name == "pause") {
    command.what = What::kPause;
    complete = read_pause(*object, command);
  } else if (name == "hand") {
    command.what = What::kHand;
    complete = read_target(*object, command);
  } else if (name == "shown") {
    command.what = What::kShown;
    complete = read_shown(*object, command);
  } else if (name == "take_control") {
    command.what = What::kTakeControl;
  } else if (name == "method") {
    command.what = What::kMethod;
    const auto method = count_of(*object, "method");
    complete = method.has_value();
    command.method = method.value_or(0);
  } else if (name == "play") {
    command.what = What::kPlay;
    complete = read_play(*object, command);
  } else if (name == "seek") {
    command.what = What::kSeek;
    complete = read_between(*object, "time_s", 0.0, kLatest_s, command.time_s);
  } else if (name == "set") {
    command.what = What::kSet;
    complete = read_setting(*object, command);
  } else if (name == "tool") {
    command.what = What::kTool;
    const auto tool = count_of(*object, "tool");
    complete = tool.has_value() && *tool < kMostTools;
    command.tool = tool.value_or(0);
  } else if (name == "field") {
    command.what = What::kField;
    complete = read_slice(*object, command);
  } else if (name == "layers") {
    command.what = What::kLayers;
    complete = read_flag(*object, "blocks", command.blocks) &&
               (!object->contains("inside") || read_flag(*object, "inside", command.inside));
  } else {
    return std::nullopt;
  }
  return complete ? std::optional(command) : std::nullopt;
}

const char* name_of(What what) noexcept {
  switch (what) {
    case What::kStop:
      return "stop";
    case What::kPause:
      return "pause";
    case What::kHand:
      return "hand";
    case What::kShown:
      return "shown";
    case What::kTakeControl:
      return "take_control";
    case What::kField:
      return "field";
    case What::kLayers:
      return "layers";
    case What::kMethod:
      return "method";
    case What::kPlay:
      return "play";
    case What::kSeek:
      return "seek";
    case What::kSet:
      return "set";
    case What::kTool:
      return "tool";
  }
  return "";
}

std::string command_json(const PageCommand& command, std::uint64_t id) {
  json object = {{"id", id}, {"what", name_of(command.what)}};
  if (command.what == What::kPause) {
    object["value"] = command.pause;
  } else if (command.what == What::kHand) {
    object["target_W_m"] = command.target_W_m ? json(*command.target_W_m) : json(nullptr);
  } else if (command.what == What::kMethod) {
    object["method"] = command.method;
  } else if (command.what == What::kSet) {
    object["name"] = command.setting;
    object["value"] = command.value;
  } else if (command.what == What::kShown) {
    object["cycle"] = command.cycle;
  } else if (command.what == What::kPlay) {
    object["value"] = command.play;
    object["speed"] = command.speed;
  } else if (command.what == What::kSeek) {
    object["time_s"] = command.time_s;
  }
  return object.dump();
}

}  // namespace forcegrid::view
