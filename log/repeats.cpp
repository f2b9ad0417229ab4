// SPDX-License-Identifier: Apache-2.0
#include "log/repeats.h"

#include <algorithm>
#include <utility>

namespace forcegrid::log {
namespace {

bool same(const Message& a, const Message& b) {
  return a.text == b.text && a.component == b.component && a.process == b.process &&
         a.level == b.level && a.where == b.where;
}

}  // namespace

void Repeats::say_count(Said& said, std::vector<Message>& now) {
  if (said.again > 0) {
    now.push_back(said.message);
    now.back().repeats = std::exchange(said.again, 0);
  }
}

// The newest one's times are the count's. What a child says may be a count itself.
void Repeats::count(Said& said, const Message& message, std::vector<Message>& now) {
  said.message = message;
  said.again += std::max<std::uint64_t>(message.repeats, 1);
  if (message.servo_time_ns - said.time_ns >= kPatience_ns) {
    say_count(said, now);
    said.time_ns = message.servo_time_ns;
  }
}

std::vector<Message> Repeats::take(const Message& message) {
  std::vector<Message> now;
  if (message.component == kRawComponent) {
    now.push_back(message);
    return now;
  }
  if (message.process.empty()) {
    if (own_ && same(own_->message, message) && message.level < Level::kError) {
      count(*own_, message, now);
      return now;
    }
    if (own_) {
      say_count(*own_, now);
    }
    own_ = Said{message, 0, message.servo_time_ns};
    now.push_back(message);
    return now;
  }
  const auto known = std::find_if(children_.begin(), children_.end(),
                                  [&](const Said& said) { return same(said.message, message); });
  if (known != children_.end() && message.level < Level::kError) {
    count(*known, message, now);
    return now;
  }
  if (known == children_.end()) {
    if (children_.size() == kRemembered) {
      say_count(children_.front(), now);
      children_.erase(children_.begin());
    }
    children_.push_back({message, 0, message.servo_time_ns});
  }
  now.push_back(message);
  return now;
}

std::vector<Message> Repeats::end() {
  std::vector<Message> now;
  if (own_) {
    say_count(*own_, now);
  }
  for (Said& said : children_) {
    say_count(said, now);
  }
  return now;
}

}  // namespace forcegrid::log
