// SPDX-License-Identifier: Apache-2.0
#include "view/surfaces.h"

#include <string>

#include "view_link/inside_messages.h"
#include "view_link/surface_messages.h"

namespace forcegrid::view {
namespace {

using view_link::Frame;
using view_link::InsideType;
using view_link::SurfaceType;
using view_link::ViewLinkError;

SharedBytes page_message(PageType type, const Frame& frame) {
  return message_of(type, static_cast<std::uint8_t>(frame.object), frame.payload);
}

std::string of_bytes(const char* what, const Frame& frame) {
  return std::string("its ") + what + " of " + std::to_string(frame.payload.size()) + " bytes";
}

}  // namespace

void Surfaces::News::put(Outbox& outbox) const {
  switch (type) {
    case PageType::kShape:
      return outbox.set_shape(object, message);
    case PageType::kSurface:
      return outbox.set_surface(object, message);
    case PageType::kInsideLines:
      return outbox.set_inside_lines(object, message);
    case PageType::kInsideFrame:
      return outbox.set_inside_frame(object, message);
    default:
      return;
  }
}

std::optional<Surfaces::News> Surfaces::take(std::uint64_t peer, const Frame& frame) {
  if (frame.object >= kMostObjects) {
    throw ViewLinkError("object " + std::to_string(frame.object) + "; there are 0 to " +
                        std::to_string(kMostObjects - 1));
  }
  switch (frame.type) {
    case static_cast<std::uint16_t>(SurfaceType::kShape):
      return take_shape(peer, frame);
    case static_cast<std::uint16_t>(SurfaceType::kFrame):
      check_owner(peer, frame.object);
      return take_frame(frame, false);
    case static_cast<std::uint16_t>(InsideType::kLines):
      check_owner(peer, frame.object);
      return take_lines(frame);
    case static_cast<std::uint16_t>(InsideType::kFrame):
      check_owner(peer, frame.object);
      return take_frame(frame, true);
    default:
      throw ViewLinkError("a frame of unknown type " + std::to_string(frame.type));
  }
}

void Surfaces::check_owner(std::uint64_t peer, std::size_t object) const {
  if (objects_[object].peer != peer) {
    throw ViewLinkError("a surface of object " + std::to_string(object) + " before its shape");
  }
}

// A shape also ends the inside: its simulator sends that again if it is still wished.
Surfaces::News Surfaces::take_shape(std::uint64_t peer, const Frame& frame) {
  Object& object = objects_[frame.object];
  if (object.peer && *object.peer != peer) {
    throw ViewLinkError("object " + std::to_string(frame.object) +
                        " belongs to another simulator; use another number");
  }
  const auto shape = view_link::decode_shape(frame.payload);
  if (!shape) {
    throw ViewLinkError(of_bytes("shape", frame) +
                        " is truncated, too large, not finite, or has a corner that is no vertex");
  }
  object = {peer,
            {shape->epoch, shape->rest_W_m.size(), page_message(PageType::kShape, frame), nullptr},
            {}};
  if (peers_.insert(peer).second && inside_wished_) {
    tell(peer);
  }
  return {PageType::kShape, frame.object, object.surface.shape};
}

Surfaces::News Surfaces::take_lines(const Frame& frame) {
  const auto lines = view_link::decode_lines(frame.payload);
  if (!lines) {
    throw ViewLinkError(of_bytes("inside", frame) +
                        " is truncated, too large, or has an edge without a vertex");
  }
  Part& inside = objects_[frame.object].inside;
  inside = {lines->epoch, lines->vertices, page_message(PageType::kInsideLines, frame), nullptr};
  return {PageType::kInsideLines, frame.object, inside.shape};
}

std::optional<Surfaces::News> Surfaces::take_frame(const Frame& frame, bool of_inside) {
  const char* const name = of_inside ? "inside" : "surface";
  Part& part = of_inside ? objects_[frame.object].inside : objects_[frame.object].surface;
  const auto decoded = view_link::decode_frame(frame.payload);
  if (!decoded) {
    throw ViewLinkError(of_bytes(name, frame) + " is truncated, too large or not finite");
  }
  if (!part.shape || decoded->epoch != part.epoch) {
    return std::nullopt;
  }
  if (decoded->position_W_m.size() != part.vertices) {
    throw ViewLinkError(std::string("its ") + name + " has " +
                        std::to_string(decoded->position_W_m.size()) + " vertices, its shape " +
                        std::to_string(part.vertices));
  }
  const PageType type = of_inside ? PageType::kInsideFrame : PageType::kSurface;
  part.frame = page_message(type, frame);
  return News{type, frame.object, part.frame};
}

std::vector<std::size_t> Surfaces::lose(std::uint64_t peer) {
  std::vector<std::size_t> gone;
  for (std::size_t object = 0; object < kMostObjects; ++object) {
    if (objects_[object].peer == peer) {
      objects_[object] = {};
      gone.push_back(object);
    }
  }
  peers_.erase(peer);
  return gone;
}

void Surfaces::wish_inside(bool wished) {
  if (wished == inside_wished_) {
    return;
  }
  inside_wished_ = wished;
  for (Object& object : objects_) {
    object.inside.frame = nullptr;  // it is of long ago when the next page wishes it
  }
  for (const std::uint64_t peer : peers_) {
    tell(peer);
  }
}

void Surfaces::tell(std::uint64_t peer) const {
  if (tell_) {
    tell_(peer, view_link::encode_wish(inside_wished_));
  }
}

void Surfaces::give(Outbox& outbox) const {
  for (std::size_t object = 0; object < kMostObjects; ++object) {
    const Part& surface = objects_[object].surface;
    if (surface.shape) {
      outbox.set_shape(object, surface.shape);
    }
    if (surface.frame) {
      outbox.set_surface(object, surface.frame);
    }
  }
}

void Surfaces::give_inside(Outbox& outbox) const {
  for (std::size_t object = 0; object < kMostObjects; ++object) {
    const Part& inside = objects_[object].inside;
    if (inside.shape) {
      outbox.set_inside_lines(object, inside.shape);
    }
    if (inside.frame) {
      outbox.set_inside_frame(object, inside.frame);
    }
  }
}

}  // namespace forcegrid::view
