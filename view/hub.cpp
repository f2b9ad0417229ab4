// SPDX-License-Identifier: Apache-2.0
#include "view/hub.h"

#include <algorithm>
#include <cstring>

#include "rt/vectors.h"
#include "view/storage_blocks.h"

namespace forcegrid::view {
namespace {

using nlohmann::json;
using view_link::FeedType;
using view_link::Frame;
using view_link::ViewLinkError;

constexpr std::size_t kMostNotes = 20;
constexpr std::size_t kMostPending = 256;
constexpr std::int64_t kSlice_ns = 60'000'000;    // between two slices, whoever wants them
constexpr std::int64_t kBlocks_ns = 250'000'000;  // between two looks at the blocks of storage

json object_of(const Frame& frame, const char* what) {
  std::optional<json> object = parse_object(view_link::text_of(frame));
  if (!object) {
    throw ViewLinkError(std::string("its ") + what +
                        " is no JSON object in UTF-8, or is nested too deep");
  }
  return std::move(*object);
}

// The structs that the payload is made of.
template <typename T>
std::vector<T> structs_of(const Frame& frame, const char* what) {
  if (frame.payload.empty() || frame.payload.size() % sizeof(T) != 0) {
    throw ViewLinkError(std::string("its ") + what + " have " +
                        std::to_string(frame.payload.size()) + " bytes, no multiple of " +
                        std::to_string(sizeof(T)));
  }
  std::vector<T> values(frame.payload.size() / sizeof(T));
  std::memcpy(values.data(), frame.payload.data(), frame.payload.size());
  return values;
}

// Of times that a peer sent: they may be any.
std::int64_t nanoseconds_between(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(to_ns) -
                                   static_cast<std::uint64_t>(from_ns));
}

Eigen::Vector3d vector_of(const json& list) {
  return rt::to_vector(list.get<std::array<double, 3>>());
}

// Copies of the methods that the hello describes; nothing if it does not say how they were made.
std::optional<MethodCopies> copies_of(const json& hello) {
  const auto facts = hello.find("copies");
  if (facts == hello.end()) {
    return std::nullopt;
  }
  try {
    MethodCopies::Options options;
    options.methods = hello.at("methods").get<std::vector<std::string>>();
    options.max_force_N = hello.at("largest_force_N");
    options.simulator_rate_Hz = hello.at("simulator_rate_Hz");
    options.fill_budget = facts->at("fill_budget");
    options.requests_per_s = facts->at("requests_per_s");
    options.base.grid.min_W = vector_of(facts->at("low_W_m"));
    options.base.grid.max_W = vector_of(facts->at("high_W_m"));
    const auto cells = facts->at("cells").get<std::array<int, 3>>();
    options.base.grid.cells = {cells[0], cells[1], cells[2]};
    options.base.influence_radius_m = facts->at("influence_radius_m");
    options.base.unit_m = facts->at("unit_m");
    options.base.samples_per_cell = facts->at("samples_per_cell");
    if (!facts->at("budget_reads").is_null()) {
      options.base.budget_reads = facts->at("budget_reads").get<double>();
    }
    return std::optional<MethodCopies>(std::in_place, std::move(options));
  } catch (const std::exception& error) {  // of JSON, or of a method
    throw ViewLinkError(std::string("its hello describes methods that can't be copied: ") +
                        error.what());
  }
}

}  // namespace

template <typename Change>
void Hub::change_all(const Change& change) {
  for (Viewer* viewer : viewers_) {
    change(viewer->outbox);
    if (!quiet_) {
      viewer->wake();
    }
  }
}

void Hub::say(Viewer& viewer, const json& text, bool after_rows) {
  viewer.outbox.add_text(text.dump(), after_rows);
  viewer.wake();
}

void Hub::say_to_all(const json& text, bool after_rows) {
  const std::string dumped = text.dump();
  for (Viewer* viewer : viewers_) {
    viewer->outbox.add_text(dumped, after_rows);
    viewer->wake();
  }
}

// ---- The feed ----

void Hub::take_feed(const Frame& frame) {
  const auto type = static_cast<FeedType>(frame.type);
  if ((feed_ == Feed::kLive) == (type == FeedType::kHello)) {
    throw ViewLinkError(feed_ == Feed::kLive ? "a second hello"
                                             : "a frame of type " + std::to_string(frame.type) +
                                                   " before the hello or after the end");
  }
  switch (type) {
    case FeedType::kHello:
      return take_hello(frame);
    case FeedType::kCycles:
      return take_cycles(frame);
    case FeedType::kSamples:
      return take_samples(frame);
    case FeedType::kArm: {
      if (!arm_is_sound(frame.payload)) {
        throw ViewLinkError("its arm is no list of lines with finite points");
      }
      const auto tool = static_cast<std::uint8_t>(options_.tool);
      const SharedBytes message = message_of(PageType::kArm, tool, frame.payload);
      newest_arm_ = message;
      return change_all([&](Outbox& outbox) { outbox.set_arm(options_.tool, message); });
    }
    case FeedType::kNote:
      return take_note(object_of(frame, "note"));
    case FeedType::kAcknowledged:
      return take_acknowledgement(object_of(frame, "acknowledgement"));
    case FeedType::kSettings:
      return take_settings(object_of(frame, "settings"));
    case FeedType::kEnd: {
      end_ = object_of(frame, "end");
      end_["type"] = "end";
      if (const auto row = rows_->take_rest()) {
        change_all([&](Outbox& outbox) { outbox.add_row(*row); });
      }
      feed_ = Feed::kEnded;
      return say_to_all(end_, true);
    }
    case FeedType::kPlayback:
      return take_playback(object_of(frame, "playback"));
    case FeedType::kCommand:
      break;
  }
  throw ViewLinkError("a frame of unknown type " + std::to_string(frame.type));
}

void Hub::take_hello(const Frame& frame) {
  json hello = object_of(frame, "hello");
  const auto methods = hello.find("methods");
  if (methods == hello.end() || !methods->is_array()) {
    throw ViewLinkError("its hello has no list of methods");
  }
  copies_ = copies_of(hello);
  if (copies_) {
    const json& copies = hello["copies"];
    hello["grid"] = {{"low_W_m", copies["low_W_m"]},
                     {"high_W_m", copies["high_W_m"]},
                     {"cells", copies["cells"]}};
  }
  hello.erase("copies");
  hello["field"] = copies_.has_value();
  hello["blocks"] = copies_.has_value();
  hello["inside"] = !hello.contains("recording");  // it has none
  hello["type"] = "hello";
  hello["columns"] = scope_columns();
  playback_ = nullptr;
  quiet_ = false;
  hello_ = std::move(hello);
  begin_anew(json::object());
  feed_ = Feed::kLive;
  notes_.clear();
  for (Viewer* viewer : viewers_) {
    viewer->slice.reset();  // it was for other methods
    viewer->blocks = false;
    say_hello(*viewer);
  }
}

void Hub::take_cycles(const Frame& frame) {
  bool any = false;
  for (const auto& cycle : structs_of<view_link::FeedCycle>(frame, "cycles")) {
    touching_W_ = rt::to_vector(cycle.touching_W_m);
    if (copies_) {
      copies_->take(cycle);
      send_slice(cycle.time_ns);
      send_blocks(cycle.time_ns);
    }
    if (const auto row = rows_->add(cycle)) {
      any = true;
      newest_row_ = row;
      for (Viewer* viewer : viewers_) {
        viewer->outbox.add_row(*row);
      }
    }
  }
  if (any) {
    change_all([](Outbox&) {});
  }
}

// One page's slice at a time, so that many pages cost no more than one.
void Hub::send_slice(std::int64_t time_ns) {
  const bool is_due = !slice_ns_ || nanoseconds_between(*slice_ns_, time_ns) >= kSlice_ns;
  if (quiet_ || viewers_.empty() || !is_due || !touching_W_.allFinite()) {
    return;
  }
  for (std::size_t tried = 0; tried < viewers_.size(); ++tried) {
    Viewer& viewer = *viewers_[++slice_turn_ % viewers_.size()];
    if (viewer.slice) {
      slice_ns_ = time_ns;
      return send_slice(viewer);
    }
  }
}

void Hub::send_slice(Viewer& viewer) {
  viewer.outbox.set_field(
      std::make_shared<view_link::Bytes>(slice_message(*copies_, *viewer.slice, touching_W_)));
  viewer.wake();
}

// The same for all pages, and only what has changed.
void Hub::send_blocks(std::int64_t time_ns) {
  const bool is_due = !blocks_ns_ || nanoseconds_between(*blocks_ns_, time_ns) >= kBlocks_ns;
  const auto wants = [](const Viewer* viewer) { return viewer->blocks; };
  if (quiet_ || !is_due || std::none_of(viewers_.begin(), viewers_.end(), wants)) {
    return;
  }
  blocks_ns_ = time_ns;
  view_link::Bytes message = blocks_message(*copies_);
  if (newest_blocks_ && *newest_blocks_ == message) {
    return;
  }
  newest_blocks_ = std::make_shared<view_link::Bytes>(std::move(message));
  for (Viewer* viewer : viewers_) {
    if (viewer->blocks) {
      viewer->outbox.set_blocks(newest_blocks_);
      viewer->wake();
    }
  }
}

void Hub::take_samples(const Frame& frame) {
  for (const auto& sample : structs_of<view_link::FeedSample>(frame, "samples")) {
    if (copies_) {
      copies_->take(sample);
    }
    const auto bytes = sample_bytes(sample, rows_->seconds_of(sample.arrived_ns));
    for (Viewer* viewer : viewers_) {
      viewer->outbox.add_sample(bytes);
    }
  }
  change_all([](Outbox&) {});
}

void Hub::take_note(json note) {
  note["type"] = "note";
  if (notes_.size() == kMostNotes) {
    notes_.pop_front();
  }
  notes_.push_back(note);
  say_to_all(note);
}

// ---- Recordings ----

void Hub::take_playback(json playback) {
  const auto state = playback.find("state");
  if (hello_.find("recording") == hello_.end() || state == playback.end() || !state->is_string()) {
    throw ViewLinkError("a playback without a state, or of no recording");
  }
  const bool seeking = *state == "seeking";
  const bool stands = *state == "paused";
  if (playback.contains("anew")) {
    begin_anew(playback);
  }
  if (stands) {  // no cycle comes that would end the bucket
    if (const auto row = rows_->take_rest()) {
      newest_row_ = row;
      change_all([&](Outbox& outbox) { outbox.add_row(*row); });
    }
  }
  const bool arrived = quiet_ && !seeking;
  playback["type"] = "playback";
  playback_ = playback;
  playback_.erase("anew");
  quiet_ = seeking;
  say_to_all(playback);
  if (arrived && copies_) {
    for (Viewer* viewer : viewers_) {
      if (viewer->slice && touching_W_.allFinite()) {
        send_slice(*viewer);
      }
    }
    blocks_ns_.reset();
    send_blocks(0);
  }
}

// What comes next is not what follows the cycles that came.
// @param playback  "anew": {"missed_deadlines": before that}
void Hub::begin_anew(const json& playback) {
  try {
    std::optional<std::int64_t> first_ns;
    if (hello_.contains("recording")) {
      first_ns = hello_["recording"].at("first_ns").get<std::int64_t>();
    }
    const std::uint64_t missed_deadlines =
        playback.contains("anew") ? playback["anew"].at("missed_deadlines").get<std::uint64_t>()
                                  : 0;
    rows_.emplace(std::min(hello_.at("methods").size(), view_link::kFeedMethods), first_ns,
                  missed_deadlines);
  } catch (const json::exception& error) {
    throw ViewLinkError(std::string("its recording or playback is not complete: ") + error.what());
  }
  if (copies_) {
    copies_->restart();
  }
  slice_ns_.reset();
  blocks_ns_.reset();
  newest_blocks_ = nullptr;
  newest_row_.reset();
  newest_arm_ = nullptr;
  for (Viewer* viewer : viewers_) {
    viewer->outbox.forget_run(options_.tool);
  }
}

// Its id is the server's; the page gets its own back.
void Hub::take_acknowledgement(json acknowledgement) {
  const auto id = acknowledgement.find("id");
  if (id == acknowledgement.end() || !id->is_number_unsigned()) {
    throw ViewLinkError("its acknowledgement has no id");
  }
  const auto run_id = id->get<std::uint64_t>();
  const auto found = std::find_if(pending_.begin(), pending_.end(),
                                  [&](const Pending& one) { return one.run_id == run_id; });
  if (found != pending_.end()) {
    acknowledgement["id"] = found->page_id;
    acknowledgement["type"] = "acknowledged";
    say(*found->viewer, acknowledgement);
  }
}

// Pages that come later get them with the hello.
void Hub::take_settings(json settings) {
  const auto list = settings.find("settings");
  if (list == settings.end() || !list->is_array()) {
    throw ViewLinkError("its settings are no list");
  }
  hello_["settings"] = *list;
  settings["type"] = "settings";
  say_to_all(settings);
}

void Hub::feed_lost() {
  pending_.clear();
  if (feed_ != Feed::kLive) {
    return;
  }
  feed_ = Feed::kWaiting;
  rows_.reset();
  notes_.clear();
  say_to_all({{"type", "waiting"}}, true);
}

// ---- Surfaces ----

void Hub::take_surface(std::uint64_t peer, const Frame& frame) {
  if (const auto news = options_.surfaces->take(peer, frame)) {
    show(*news);
  }
}

void Hub::show(const Surfaces::News& news) {
  for (Viewer* viewer : viewers_) {
    if (viewer->inside || !news.is_inside()) {
      news.put(viewer->outbox);
      if (!quiet_) {
        viewer->wake();
      }
    }
  }
}

void Hub::surface_lost(std::uint64_t peer) { show_lost(options_.surfaces->lose(peer)); }

void Hub::show_lost(const std::vector<std::size_t>& objects) {
  for (const std::size_t object : objects) {
    change_all([&](Outbox& outbox) { outbox.forget_surface(object); });
    say_to_all({{"type", "surface_lost"}, {"object", object}});
  }
}

// Simulators send it as long as any page shows it.
void Hub::wish_inside() {
  options_.surfaces->wish_inside(
      inside_wished() || (options_.inside_wished_elsewhere && options_.inside_wished_elsewhere()));
}

bool Hub::inside_wished() const noexcept {
  return std::any_of(viewers_.begin(), viewers_.end(),
                     [](const Viewer* viewer) { return viewer->inside; });
}

// ---- Pages ----

const char* Hub::role_of(const Viewer& viewer) const noexcept {
  return is_controller(viewer) ? "controller" : "viewer";
}

void Hub::say_hello(Viewer& viewer) {
  json hello = hello_;
  hello["role"] = role_of(viewer);
  hello["tool"] = options_.tool;
  say(viewer, hello);
}

void Hub::say_role(Viewer& viewer) {
  say(viewer,
      {{"type", "role"}, {"role", role_of(viewer)}, {"control_is_free", controller_ == nullptr}});
}

void Hub::join(Viewer& viewer, bool with_surfaces) {
  viewers_.push_back(&viewer);
  if (controller_ == nullptr) {
    controller_ = &viewer;
  }
  if (feed_ == Feed::kWaiting) {
    say(viewer, {{"type", "waiting"}});
    say_role(viewer);
  } else {
    say_hello(viewer);
    if (!playback_.is_null()) {
      say(viewer, playback_);
      if (newest_row_) {
        viewer.outbox.add_row(*newest_row_);
      }
      if (newest_arm_) {
        viewer.outbox.set_arm(options_.tool, newest_arm_);
      }
    }
  }
  for (const json& note : notes_) {
    say(viewer, note);
  }
  if (feed_ == Feed::kEnded) {
    say(viewer, end_);
  }
  if (with_surfaces) {
    options_.surfaces->give(viewer.outbox);
  }
  viewer.wake();
}

void Hub::leave(Viewer& viewer) {
  std::erase(viewers_, &viewer);
  wish_inside();
  std::erase_if(pending_, [&](const Pending& one) { return one.viewer == &viewer; });
  if (controller_ == &viewer) {
    controller_ = nullptr;
    for (Viewer* other : viewers_) {
      say_role(*other);
    }
  }
}

void Hub::forget_viewers() noexcept {
  options_.surfaces->stop_telling();
  viewers_.clear();
  pending_.clear();
  controller_ = nullptr;
}

void Hub::take_page(Viewer& viewer, std::string_view text) {
  const std::optional<PageCommand> command = parse_command(text);
  if (!command) {
    throw ViewLinkError("a text of " + std::to_string(text.size()) + " bytes that is no command");
  }
  if (command->what == PageCommand::What::kTool) {
    refuse(viewer, *command, "there is one tool");
  } else if (command->what == PageCommand::What::kTakeControl) {
    take_control(viewer);
  } else if (command->what == PageCommand::What::kField) {
    take_slice_wish(viewer, *command);
  } else if (command->what == PageCommand::What::kLayers) {
    take_layers(viewer, *command);
  } else if (command->what == PageCommand::What::kStop || is_controller(viewer)) {
    forward(viewer, *command);
  } else if (command->what != PageCommand::What::kShown) {
    refuse(viewer, *command, "another page has control");
  }
}

// Any page may ask: it changes nothing but its own picture.
void Hub::take_slice_wish(Viewer& viewer, const PageCommand& command) {
  viewer.slice.reset();
  viewer.outbox.set_field(nullptr);
  if (!command.slice) {
    return;
  }
  const std::string problem = copies_ ? problem_of(*command.slice, copies_->size())
                                      : "the run did not say how its methods are made";
  if (!problem.empty()) {
    return refuse(viewer, command, problem);
  }
  viewer.slice = command.slice;
  if (!playback_.is_null() && playback_["state"] == "paused" && touching_W_.allFinite()) {
    send_slice(viewer);  // no cycle comes that would
  }
}

// Any page may, likewise.
void Hub::take_layers(Viewer& viewer, const PageCommand& command) {
  const bool inside_begins = command.inside && !viewer.inside;
  viewer.inside = command.inside;
  wish_inside();
  if (inside_begins) {
    options_.surfaces->give_inside(viewer.outbox);
    viewer.wake();
  } else if (!viewer.inside) {
    for (std::size_t object = 0; object < kMostObjects; ++object) {
      viewer.outbox.forget_inside(object);
    }
  }
  viewer.blocks = command.blocks && copies_;
  viewer.outbox.set_blocks(nullptr);
  if (command.blocks && !copies_) {
    refuse(viewer, command, "the run did not say how its methods are made");
  } else if (viewer.blocks) {
    newest_blocks_ = nullptr;  // this page has none yet
    blocks_ns_.reset();
    send_blocks(0);
  }
}

void Hub::take_control(Viewer& viewer) {
  if (controller_ == nullptr) {
    controller_ = &viewer;
    for (Viewer* each : viewers_) {
      say_role(*each);
    }
  } else {
    say_role(viewer);
  }
}

void Hub::forward(Viewer& viewer, const PageCommand& command) {
  const std::uint64_t id = next_id_++;
  const bool newest = command.what == PageCommand::What::kHand ||
                      command.what == PageCommand::What::kShown ||
                      command.what == PageCommand::What::kSeek;
  const Frame frame = view_link::text_frame(static_cast<std::uint16_t>(FeedType::kCommand),
                                            command_json(command, id));
  if (feed_ != Feed::kLive) {
    refuse(viewer, command, feed_ == Feed::kEnded ? "the run has ended" : "no run is connected");
  } else if (!send_command_(frame, command.what, newest)) {
    refuse(viewer, command, "the run does not read its commands");
  } else if (command.what != PageCommand::What::kShown) {
    remember({id, command.id, command.what, &viewer});
  }
}

// A move of the hand takes the place of the one before: there are sixty a second.
void Hub::remember(const Pending& command) {
  if (command.what == PageCommand::What::kHand || command.what == PageCommand::What::kSeek) {
    std::erase_if(pending_, [&](const Pending& one) {
      return one.what == command.what && one.viewer == command.viewer;
    });
  }
  if (pending_.size() == kMostPending) {
    pending_.pop_front();
  }
  pending_.push_back(command);
}

void Hub::refuse(Viewer& viewer, const PageCommand& command, const std::string& why) {
  if (command.what != PageCommand::What::kShown) {
    say(viewer, {{"type", "acknowledged"},
                 {"id", command.id},
                 {"what", name_of(command.what)},
                 {"done", false},
                 {"text", why}});
  }
}

}  // namespace forcegrid::view
