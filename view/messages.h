// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "view/field_slice.h"
#include "view_link/feed_messages.h"
#include "view_link/frame.h"

/// What goes to the page and what comes from it (docs/view_protocol.md).
/// Real-time: no. Threads: any.
namespace forcegrid::view {

/// First byte of a binary message to the page.
enum class PageType : std::uint8_t {
  kScope = 1,
  kShape = 2,
  kSurface = 3,
  kSamples = 4,
  kArm = 5,
  kField = 6,
  kBlocks = 7,
  kInsideLines = 8,
  kInsideFrame = 9,
  kOtherTool = 10,
};

using SharedBytes = std::shared_ptr<const view_link::Bytes>;

inline constexpr std::size_t kMostTools = 4;     ///< that one view shows
inline constexpr std::size_t kSampleBytes = 48;  ///< of one sample in a message of type 4
inline constexpr std::size_t kLargestPageText = 4096;

/// The nearest float; NaN stays NaN. What is out of range becomes the largest of its sign.
inline float narrow(double number) noexcept {
  constexpr double kMost = std::numeric_limits<float>::max();
  return static_cast<float>(number > kMost ? kMost : number < -kMost ? -kMost : number);
}

/// Type, object and two zero bytes.
view_link::Bytes message_head(PageType type, std::uint8_t object);
/// The head and then `payload` as it is.
SharedBytes message_of(PageType type, std::uint8_t object, std::span<const std::uint8_t> payload);

/// A sample for the page. @param time_s  when it arrived, since the feed's first cycle.
std::array<std::uint8_t, kSampleBytes> sample_bytes(const view_link::FeedSample& sample,
                                                    double time_s);

/// Where a tool is that the page does not show the scope of, its force and whether it is in
/// contact.
SharedBytes other_tool_message(std::size_t tool, const view_link::FeedCycle& cycle);

/// Whether the payload is a number of lines with finite points and nothing else.
bool arm_is_sound(std::span<const std::uint8_t> payload);

/// The object that `text` is; nothing for what is no JSON, not UTF-8, another value than an object,
/// or nested deeper than 16 levels.
std::optional<nlohmann::json> parse_object(std::string_view text);

/// What a page asks for.
// JSON moves without throwing, by functions that could.
// NOLINTNEXTLINE(bugprone-exception-escape)
struct PageCommand {
  enum class What {
    kStop,
    kPause,
    kHand,
    kShown,
    kTakeControl,
    kField,
    kLayers,
    kMethod,
    kPlay,
    kSeek,
    kSet,
    kTool
  };
  What what = What::kStop;
  std::uint64_t id = 0;  ///< of the page; 0 if it gives none
  bool pause = false;
  std::optional<std::array<double, 3>> target_W_m;  ///< nothing: let go
  std::uint64_t cycle = 0;                          ///< modulo 2^24, that the page has drawn
  std::uint64_t method = 0;                         ///< that is to be rendered
  std::optional<SliceWish> slice;                   ///< nothing: the page wants none
  bool blocks = false;                              ///< the page shows blocks of storage
  bool inside = false;                              ///< and what is inside of the objects
  bool play = false;                                ///< of a recording; false: stand still
  double speed = 1.0;                               ///< of its time over the person's
  double time_s = 0.0;                              ///< where to go in it, since its first cycle
  std::string setting;                              ///< its name
  nlohmann::json value;                             ///< a finite number, a short text or null
  std::size_t tool = 0;                             ///< that the page is to show, < kMostTools
};

/// Nothing for what is too long, unknown, incomplete or out of range; a target is finite and within
/// 10 m, a speed 0.01 to 100, a time 0 to 1e9 s.
std::optional<PageCommand> parse_command(std::string_view text);
/// The command as the run gets it, with the server's own `id`.
std::string command_json(const PageCommand& command, std::uint64_t id);
/// "stop", "pause", ...
const char* name_of(PageCommand::What what) noexcept;

}  // namespace forcegrid::view
