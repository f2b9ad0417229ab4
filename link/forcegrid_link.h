// SPDX-License-Identifier: Apache-2.0
/* The simulator's end of Forcegrid's link in C99, for simulators written by others. One file, no
 * dependency: it takes and makes bytes, and leaves sockets, threads and waiting to the program.
 * docs/link_protocol.md has every byte; examples/spring_simulator.c is a complete simulator.
 *
 *   fg_link link;
 *   fg_link_init(&link, 2.0, NULL);
 *   for (;;) {
 *     n = recvfrom(socket, bytes, sizeof bytes, ...from...);
 *     switch (fg_link_take(&link, bytes, n, from, from_size, now_ns, reply, &reply_size)) {
 *       case FG_TOOL_STATE: newest = link.tool_state; ...
 *       case FG_QUERY: ...
 *     }
 *     if (reply_size > 0) sendto(socket, reply, reply_size, ...from...);
 *     ...
 *     sample = fg_answer_to_tool_state(&newest);
 *     sample.force_W_N[2] = ...;
 *     size = fg_link_make_sample(&link, &sample, now_ns, bytes);
 *     if (size > 0) sendto(socket, bytes, size, ...the servo's address...);
 *   }
 *
 * All functions are static inline, don't allocate, lock or keep global state. One fg_link belongs
 * to one thread. Units are SI; vectors are x, y, z in the workspace frame W: x toward the operator,
 * y to the operator's right, z up. Quaternions are w, x, y, z.
 *
 * A servo whose device has a wrist tells its tool's orientation and takes torques (version 3 of the
 * protocol); fg_link answers each servo in its own version. It drops version 4; a servo that tries
 * it falls back to 3 or 1 within 1.2 s.
 *
 * Without a key listen on a loopback address only: datagrams are then not authenticated, and forces
 * move real motors. With a key give fg_link_init() an fg_crypto, whose functions are one line each
 * with libsodium; fg_link does the rest (streams, replay window, freshness).
 */
#ifndef FORCEGRID_LINK_H
#define FORCEGRID_LINK_H

/* Names and declarations as in C; the magic has no end mark. */
/* NOLINTBEGIN(readability-identifier-naming) */
/* NOLINTBEGIN(modernize-use-nullptr) */
/* NOLINTBEGIN(modernize-use-using) */
/* NOLINTBEGIN(cppcoreguidelines-init-variables) */
/* NOLINTBEGIN(bugprone-not-null-terminated-result) */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  FG_MAX_DATAGRAM_BYTES = 511,
  FG_HEADER_BYTES = 24,
  FG_CHECKSUM_BYTES = 4,
  FG_SEAL_HEAD_BYTES = 56,
  FG_SEAL_TIMES_BYTES = 24,
  FG_SEAL_TAG_BYTES = 16,
  FG_SEAL_OVERHEAD_BYTES = 96,
  FG_WINDOW = 1024,
  FG_PEER_STREAMS = 16,
  FG_ADDRESS_BYTES = 32,
  FG_PATCH_VERTICES = 19,
  FG_PATCH_TRIANGLES = 27,
  FG_PATCH_MAX_OPENING_CRAD = 160,
  FG_ENDED_SESSIONS = 16
};

/* Where the tool is. */
typedef struct {
  uint32_t sequence;
  int64_t servo_time_ns; /* the servo's clock when the position was measured */
  double position_W_m[3];
  double velocity_W_m_per_s[3];
  int has_orientation;      /* else the identity and no angular velocity */
  int has_buttons;          /* else none is pressed */
  double orientation_WT[4]; /* of the rotation from the tool's frame T to W; a unit quaternion */
  double angular_velocity_W_rad_per_s[3];
  uint32_t buttons; /* bit i: the device's button i is pressed */
} fg_tool_state;

/* Asks for the force at that position. Answered in idle time, if at all. */
typedef struct {
  uint32_t query_id;
  int64_t servo_time_ns;
  double position_W_m[3];
} fg_query;

/* The force that the object exerts on the tool at position_W_m. */
typedef struct {
  uint32_t echo_sequence; /* copy these three from what is answered: fg_answer_to_...() */
  uint32_t query_id;
  int64_t echo_servo_time_ns;
  uint32_t contact_epoch; /* 0 before any contact, then a new number at every discontinuity */
  int in_contact;
  int converged;     /* the solver reached its tolerance */
  int has_stiffness; /* else stiffness_W_N_per_m is not sent */
  double position_W_m[3];
  double force_W_N[3];
  double contact_point_W_m[3];
  double relative_residual;
  double solve_time_s;
  double stiffness_W_N_per_m[9]; /* dF/dP, row by row */
  int has_torque; /* else torque_W_Nm is not sent; nor is it to a servo without wrist */
  int has_rotational_stiffness; /* with a torque only */
  double torque_W_Nm[3];        /* on the tool, about position_W_m */
  double orientation_WT[4];     /* for which it was computed; copied from the tool state */
  double rotational_stiffness_W_Nm_per_rad[9]; /* d(torque)/d(theta), row by row: theta is the
                                                  rotation vector in W by which the tool turns on */
} fg_force_sample;

/* The part of the surface that a tool in the air may touch next; optional. */
typedef struct {
  uint32_t echo_sequence; /* copy these three from the tool state: fg_patch_for_tool_state() */
  int64_t echo_servo_time_ns;
  double position_W_m[3];
  uint32_t contact_epoch;       /* that of the samples in the air */
  float tool_radius_m;          /* the tool stands upright on its tip; 0: a point */
  float tool_length_m;          /* between the ends' centres; 0: a sphere */
  unsigned tool_opening_crad;   /* 0.01 rad between two such rods, hinged at the top; 0: one rod */
  int has_stiffness;            /* else stiffness_W_N_per_m is not sent */
  float stiffness_W_N_per_m[6]; /* dF/dP just after the touch: xx, yy, zz, xy, xz, yz */
  int has_press_forces;         /* of a tool that slides; not together with has_stiffness */
  float press_forces_W_N[2][3]; /* on the tool, 1 and 2 mm deep along the outward normal */
  unsigned vertex_count;
  unsigned triangle_count;
  float vertices_W_m[FG_PATCH_VERTICES][3];       /* from position_W_m, along W's axes */
  unsigned char triangles[FG_PATCH_TRIANGLES][3]; /* counterclockwise seen from outside */
} fg_surface_patch;

/* For a link with a key. Each returns 1, or 0 when it failed. */
typedef struct {
  void* context; /* given to each */
  unsigned char key_id[8];
  /* XChaCha20-Poly1305 (IETF): writes size + 16 bytes to `to`, which may be `from`. */
  int (*encrypt)(void* context, unsigned char* to, const unsigned char* from, size_t size,
                 const unsigned char* head, size_t head_size, const unsigned char nonce[24]);
  /* The reverse: `size` counts the tag, too; 0 if that is wrong. */
  int (*decrypt)(void* context, unsigned char* to, const unsigned char* from, size_t size,
                 const unsigned char* head, size_t head_size, const unsigned char nonce[24]);
  int (*random_bytes)(void* context, unsigned char* to, size_t size);
} fg_crypto;

/* What fg_link_take() found in a datagram. */
typedef enum {
  FG_DROPPED,    /* nothing of use; counted in fg_link.dropped by its reason */
  FG_TOOL_STATE, /* the newest is in fg_link.tool_state */
  FG_QUERY,      /* it is in fg_link.query */
  FG_GOODBYE     /* the servo has ended its run */
} fg_event;

/* Why a datagram was dropped. */
typedef enum {
  FG_DROP_MALFORMED, /* wrong in form, checksum, type or range */
  FG_DROP_SEALED,    /* not sealed, unknown key, forged or reflected */
  FG_DROP_STALE,     /* authentic, but of an old session or not yet of this one */
  FG_DROP_REPLAYED,
  FG_DROP_ADDRESS, /* this session from another address */
  FG_DROP_SESSION, /* another session while a servo holds the link, or one that has ended */
  FG_DROP_DUPLICATED,
  FG_DROP_LATE,
  FG_DROP_COUNT
} fg_drop;

/* Counters that have passed; bit i of the ring belongs to the numbers i, i + FG_WINDOW, ... */
typedef struct {
  uint64_t newest;
  unsigned char passed[FG_WINDOW / 8];
} fg_window;

typedef struct {
  unsigned char id[16];
  fg_window window;
} fg_stream;

/* One end of the link; the fields up to `dropped` may be read. */
typedef struct {
  fg_tool_state tool_state;
  fg_query query;
  int new_session; /* set by fg_link_take() when another run began: forget the old one's contacts */
  uint64_t session_id; /* 0: no servo */
  uint64_t dropped[FG_DROP_COUNT];

  const fg_crypto* crypto;
  int64_t silence_ns;
  int64_t last_heard_ns;
  unsigned char servo[FG_ADDRESS_BYTES];
  size_t servo_size;
  uint64_t ended[FG_ENDED_SESSIONS];
  unsigned ended_count;
  int tool_state_seen;
  int knows_poses; /* the servo speaks version 3 */
  fg_window tool_states;
  fg_window queries;
  uint32_t sample_sequence;
  uint32_t patch_sequence;
  unsigned char own_stream[16];
  uint64_t counter;
  fg_stream peers[FG_PEER_STREAMS];
  unsigned peer_count;
  unsigned char heard[16];
  int64_t heard_sent_ns;
  int64_t heard_received_ns;
} fg_link;

/* ---- bytes ---- */

static inline void fg_put(unsigned char* to, uint64_t value, int bytes) {
  int i;
  for (i = 0; i < bytes; ++i) {
    to[i] = (unsigned char)(value >> (8 * i));
  }
}

static inline uint64_t fg_get(const unsigned char* from, int bytes) {
  uint64_t value = 0;
  int i;
  for (i = 0; i < bytes; ++i) {
    value |= (uint64_t)from[i] << (8 * i);
  }
  return value;
}

static inline void fg_put_doubles(unsigned char* to, const double* values, int count) {
  int i;
  for (i = 0; i < count; ++i) {
    uint64_t bits;
    memcpy(&bits, &values[i], sizeof bits);
    fg_put(to + 8 * i, bits, 8);
  }
}

static inline void fg_put_floats(unsigned char* to, const float* values, int count) {
  int i;
  for (i = 0; i < count; ++i) {
    uint32_t bits;
    memcpy(&bits, &values[i], sizeof bits);
    fg_put(to + 4 * i, bits, 4);
  }
}

/* 1 if all are finite and within +-bound. */
static inline int fg_get_doubles(const unsigned char* from, double* values, int count,
                                 double bound) {
  int i;
  int fine = 1;
  for (i = 0; i < count; ++i) {
    const uint64_t bits = fg_get(from + 8 * i, 8);
    memcpy(&values[i], &bits, sizeof bits);
    fine = fine && isfinite(values[i]) && fabs(values[i]) <= bound;
  }
  return fine;
}

static inline int fg_within(const double* values, int count, double bound) {
  int i;
  for (i = 0; i < count; ++i) {
    if (!isfinite(values[i]) || fabs(values[i]) > bound) {
      return 0;
    }
  }
  return 1;
}

static inline int fg_floats_within(const float* values, int count, double bound) {
  int i;
  for (i = 0; i < count; ++i) {
    const double value = (double)values[i];
    if (!isfinite(value) || fabs(value) > bound) {
      return 0;
    }
  }
  return 1;
}

/* CRC-32 of zlib, PNG and Ethernet. */
static inline uint32_t fg_crc32(const unsigned char* bytes, size_t size) {
  uint32_t crc = 0xFFFFFFFFu;
  size_t i;
  int bit;
  for (i = 0; i < size; ++i) {
    crc ^= bytes[i];
    for (bit = 0; bit < 8; ++bit) {
      crc = crc >> 1 ^ (0xEDB88320u & (0u - (crc & 1u)));
    }
  }
  return ~crc;
}

/* A unit quaternion of no rotation, and whether four finite numbers are a unit quaternion. */
static inline void fg_set_identity(double* quaternion) {
  quaternion[0] = 1.0;
  quaternion[1] = quaternion[2] = quaternion[3] = 0.0;
}

static inline int fg_is_unit(const double* q) {
  return fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 1e-6;
}

static inline size_t fg_begin_datagram(const fg_link* link, unsigned char* to, unsigned type,
                                       unsigned payload_bytes, uint32_t sequence) {
  memcpy(to, "FGRD", 4);
  fg_put(to + 4, link->knows_poses ? 3 : 1, 2);
  fg_put(to + 6, type, 2);
  fg_put(to + 8, payload_bytes, 2);
  fg_put(to + 10, 0, 2);
  fg_put(to + 12, sequence, 4);
  fg_put(to + 16, link->session_id, 8);
  return FG_HEADER_BYTES + (size_t)payload_bytes;
}

static inline size_t fg_end_datagram(unsigned char* datagram, size_t size) {
  fg_put(datagram + size, fg_crc32(datagram, size), 4);
  return size + FG_CHECKSUM_BYTES;
}

/* ---- replay window ---- */

static inline int fg_window_bit(fg_window* window, uint64_t number, int set) {
  unsigned char* byte = &window->passed[number % FG_WINDOW / 8];
  const unsigned char mask = (unsigned char)(1u << (number % 8));
  const int was = (*byte & mask) != 0;
  *byte = (unsigned char)(set ? *byte | mask : *byte & ~mask);
  return was;
}

/* 1 the first time for each number, 0 for a repeated one or one too far behind; 0 is no number. */
static inline int fg_window_pass(fg_window* window, uint64_t number) {
  if (number > window->newest) {
    const uint64_t step = number - window->newest;
    uint64_t i;
    if (step >= FG_WINDOW) {
      memset(window->passed, 0, sizeof window->passed);
    } else {
      for (i = 1; i < step; ++i) {
        fg_window_bit(window, window->newest + i, 0);
      }
    }
    window->newest = number;
    fg_window_bit(window, number, 1);
    return 1;
  }
  return number != 0 && window->newest - number < FG_WINDOW && !fg_window_bit(window, number, 1);
}

/* The same for 32-bit numbers that wrap (RFC 1982): as 64-bit numbers around the newest. */
static inline uint64_t fg_unwrap(const fg_window* window, uint32_t number) {
  const uint64_t base = window->newest != 0 ? window->newest : ((uint64_t)1 << 32) + number;
  return base + (uint64_t)(int64_t)(int32_t)(number - (uint32_t)base);
}

/* ---- sealing ---- */

static inline int fg_begin_stream(fg_link* link) {
  link->counter = 0;
  link->peer_count = 0;
  return link->crypto->random_bytes(link->crypto->context, link->own_stream,
                                    sizeof link->own_stream);
}

/* Seals `size` bytes at to + 80 for the peer with the given stream. @returns the whole size or 0.
 */
static inline size_t fg_seal(fg_link* link, unsigned char* to, size_t size,
                             const unsigned char* peer_stream, int64_t peer_sent_ns,
                             int64_t peer_received_ns, int64_t now_ns) {
  unsigned char* const secret = to + FG_SEAL_HEAD_BYTES;
  memcpy(to, "FGRS", 4);
  fg_put(to + 4, 1, 2);
  to[6] = 2; /* simulator to servo */
  to[7] = 0;
  memcpy(to + 8, link->crypto->key_id, 8);
  memcpy(to + 16, link->own_stream, 16);
  fg_put(to + 32, ++link->counter, 8);
  memcpy(to + 40, peer_stream, 16);
  fg_put(secret, (uint64_t)now_ns, 8);
  fg_put(secret + 8, (uint64_t)peer_sent_ns, 8);
  fg_put(secret + 16, (uint64_t)peer_received_ns, 8);
  return link->crypto->encrypt(link->crypto->context, secret, secret, FG_SEAL_TIMES_BYTES + size,
                               to, FG_SEAL_HEAD_BYTES, to + 16)
             ? size + FG_SEAL_OVERHEAD_BYTES
             : 0;
}

/* Finds the stream's window, or makes one; null if there was no room and a new own stream began. */
static inline fg_window* fg_window_of(fg_link* link, const unsigned char* stream) {
  unsigned i;
  for (i = 0; i < link->peer_count; ++i) {
    if (memcmp(link->peers[i].id, stream, 16) == 0) {
      return &link->peers[i].window;
    }
  }
  if (link->peer_count == FG_PEER_STREAMS) {
    fg_begin_stream(link);
    return NULL;
  }
  memset(&link->peers[i], 0, sizeof link->peers[i]);
  memcpy(link->peers[i].id, stream, 16);
  ++link->peer_count;
  return &link->peers[i].window;
}

/* Opens `sealed` into `inside` (FG_MAX_DATAGRAM_BYTES). 1 if the datagram there may be looked at;
 * else it is counted, and there may be a reply to send. */
static inline int fg_unseal(fg_link* link, const unsigned char* sealed, size_t size, int64_t now_ns,
                            unsigned char* inside, unsigned char* reply, size_t* reply_size) {
  fg_window* window = NULL;
  int64_t sent_ns;
  if (size < FG_SEAL_OVERHEAD_BYTES || size > FG_MAX_DATAGRAM_BYTES ||
      memcmp(sealed, "FGRS\1\0\1\0", 8) != 0 || memcmp(sealed + 8, link->crypto->key_id, 8) != 0 ||
      !link->crypto->decrypt(link->crypto->context, inside, sealed + FG_SEAL_HEAD_BYTES,
                             size - FG_SEAL_HEAD_BYTES, sealed, FG_SEAL_HEAD_BYTES, sealed + 16)) {
    ++link->dropped[FG_DROP_SEALED];
    return 0;
  }
  sent_ns = (int64_t)fg_get(inside, 8);
  if (memcmp(sealed + 40, link->own_stream, 16) == 0) {
    window = fg_window_of(link, sealed + 16);
  }
  if (window == NULL) {
    ++link->dropped[FG_DROP_STALE];
    *reply_size = fg_seal(link, reply, 0, sealed + 16, sent_ns, now_ns, now_ns);
    return 0;
  }
  if (!fg_window_pass(window, fg_get(sealed + 32, 8))) {
    ++link->dropped[FG_DROP_REPLAYED];
    return 0;
  }
  memcpy(link->heard, sealed + 16, 16);
  link->heard_sent_ns = sent_ns;
  link->heard_received_ns = now_ns;
  return 1;
}

/* ---- the link ---- */

/* `silence_s`: another servo may take the link after this long without a datagram; 2 is usual.
 * `crypto`: null for a link on loopback without a key; else it outlives the link.
 * @returns 1, or 0 if there were no random bytes. */
static inline int fg_link_init(fg_link* link, double silence_s, const fg_crypto* crypto) {
  memset(link, 0, sizeof *link);
  link->silence_ns = (int64_t)(1e9 * silence_s);
  link->crypto = crypto;
  return crypto == NULL || fg_begin_stream(link);
}

static inline void fg_end_session(fg_link* link) {
  if (link->session_id != 0) {
    link->ended[link->ended_count++ % FG_ENDED_SESSIONS] = link->session_id;
  }
  link->session_id = 0;
  link->tool_state_seen = 0;
  link->knows_poses = 0;
  memset(&link->tool_states, 0, sizeof link->tool_states);
  memset(&link->queries, 0, sizeof link->queries);
}

static inline int fg_has_ended(const fg_link* link, uint64_t session_id) {
  unsigned i;
  for (i = 0; i < FG_ENDED_SESSIONS && i < link->ended_count; ++i) {
    if (link->ended[i] == session_id) {
      return 1;
    }
  }
  return 0;
}

/* Whose datagram it is; FG_DROP_COUNT for the servo that holds the link or takes it now. */
static inline fg_drop fg_check_session(fg_link* link, uint64_t session_id, int opens,
                                       const void* from, size_t from_size, int64_t now_ns) {
  const int same_address =
      from_size == link->servo_size && memcmp(from, link->servo, from_size) == 0;
  if (session_id == link->session_id) {
    if (!same_address) {
      return FG_DROP_ADDRESS;
    }
  } else {
    const int alive = link->session_id != 0 && now_ns - link->last_heard_ns < link->silence_ns;
    if (!opens || fg_has_ended(link, session_id) || (alive && !same_address)) {
      return FG_DROP_SESSION;
    }
    fg_end_session(link);
    link->session_id = session_id;
    memcpy(link->servo, from, from_size);
    link->servo_size = from_size;
    link->new_session = 1;
  }
  link->last_heard_ns = now_ns;
  return FG_DROP_COUNT;
}

static inline fg_event fg_drop_for(fg_link* link, fg_drop reason) {
  ++link->dropped[reason];
  return FG_DROPPED;
}

/* 1 if the number is new to the window; else it is counted as repeated or late. */
static inline int fg_take_number(fg_link* link, fg_window* window, uint32_t number) {
  const uint64_t unwrapped = fg_unwrap(window, number);
  if (fg_window_pass(window, unwrapped)) {
    return 1;
  }
  ++link->dropped[window->newest - unwrapped < FG_WINDOW ? FG_DROP_DUPLICATED : FG_DROP_LATE];
  return 0;
}

/* What version 3 has beyond the others, behind the velocity. 1 if it is sound. */
static inline int fg_get_pose(const unsigned char* datagram, fg_tool_state* state) {
  const uint32_t flags = (uint32_t)fg_get(datagram + 140, 4);
  const double* const q = state->orientation_WT;
  const int sound = fg_get_doubles(datagram + 80, state->orientation_WT, 4, 2.0) &&
                    fg_get_doubles(datagram + 112, state->angular_velocity_W_rad_per_s, 3, 1e3) &&
                    fg_is_unit(q) && flags <= 3;
  state->buttons = (uint32_t)fg_get(datagram + 136, 4);
  state->has_orientation = (flags & 1u) != 0;
  state->has_buttons = (flags & 2u) != 0;
  return sound && (state->has_buttons || state->buttons == 0) &&
         (state->has_orientation || (q[0] == 1.0 && q[1] == 0.0 && q[2] == 0.0 && q[3] == 0.0 &&
                                     fg_within(state->angular_velocity_W_rad_per_s, 3, 0.0)));
}

/* What an older version leaves out stays as it was. */
static inline void fg_keep_pose(fg_tool_state* state, const fg_tool_state* last) {
  state->has_orientation = last->has_orientation;
  state->has_buttons = last->has_buttons;
  memcpy(state->orientation_WT, last->orientation_WT, sizeof state->orientation_WT);
  memcpy(state->angular_velocity_W_rad_per_s, last->angular_velocity_W_rad_per_s,
         sizeof state->angular_velocity_W_rad_per_s);
  state->buttons = last->buttons;
}

/* Takes in what recvfrom() gave: `from` are the bytes of the sender's address (at most
 * FG_ADDRESS_BYTES are looked at), `now_ns` a monotonic clock. With a key there may be a `reply`
 * (FG_SEAL_OVERHEAD_BYTES of room; *reply_size is 0 if not) to be sent to `from` as it is.
 * Safe for any bytes of any length. */
static inline fg_event fg_link_take(fg_link* link, const unsigned char* bytes, size_t size,
                                    const void* from, size_t from_size, int64_t now_ns,
                                    unsigned char* reply, size_t* reply_size) {
  unsigned char inside[FG_MAX_DATAGRAM_BYTES + 1];
  const unsigned char* datagram = bytes;
  fg_tool_state state;
  fg_query query;
  fg_drop drop;
  unsigned type;
  unsigned version;
  size_t payload_bytes;
  uint32_t sequence;
  uint64_t session_id;
  *reply_size = 0;
  link->new_session = 0;
  if (from_size > FG_ADDRESS_BYTES) {
    from_size = FG_ADDRESS_BYTES;
  }
  if (link->crypto != NULL) {
    if (!fg_unseal(link, bytes, size, now_ns, inside, reply, reply_size)) {
      return FG_DROPPED;
    }
    datagram = inside + FG_SEAL_TIMES_BYTES;
    size -= FG_SEAL_OVERHEAD_BYTES;
  }
  version = size < FG_HEADER_BYTES + FG_CHECKSUM_BYTES ? 0 : (unsigned)fg_get(datagram + 4, 2);
  if ((version != 1 && version != 3) || memcmp(datagram, "FGRD", 4) != 0) {
    return fg_drop_for(link, FG_DROP_MALFORMED);
  }
  type = (unsigned)fg_get(datagram + 6, 2);
  payload_bytes = type == 1 ? (version == 3 ? 120 : 56) : type == 2 ? 32 : 0;
  sequence = (uint32_t)fg_get(datagram + 12, 4);
  session_id = fg_get(datagram + 16, 8);
  if ((type != 1 && type != 2 && type != 4) ||
      size != FG_HEADER_BYTES + payload_bytes + FG_CHECKSUM_BYTES ||
      fg_get(datagram + 8, 2) != payload_bytes || fg_get(datagram + 10, 2) != 0 ||
      session_id == 0 || fg_get(datagram + size - 4, 4) != fg_crc32(datagram, size - 4)) {
    return fg_drop_for(link, FG_DROP_MALFORMED);
  }
  memset(&state, 0, sizeof state);
  memset(&query, 0, sizeof query);
  if (type == 1) {
    state.sequence = sequence;
    state.servo_time_ns = (int64_t)fg_get(datagram + 24, 8);
    if (!fg_get_doubles(datagram + 32, state.position_W_m, 3, 10.0) ||
        !fg_get_doubles(datagram + 56, state.velocity_W_m_per_s, 3, 100.0) ||
        state.servo_time_ns < 0 || (version == 3 && !fg_get_pose(datagram, &state))) {
      return fg_drop_for(link, FG_DROP_MALFORMED);
    }
  } else if (type == 2) {
    query.query_id = sequence;
    query.servo_time_ns = (int64_t)fg_get(datagram + 24, 8);
    if (!fg_get_doubles(datagram + 32, query.position_W_m, 3, 10.0) || query.servo_time_ns < 0 ||
        query.query_id == 0) {
      return fg_drop_for(link, FG_DROP_MALFORMED);
    }
  } else if (sequence != 0) {
    return fg_drop_for(link, FG_DROP_MALFORMED);
  }
  drop = fg_check_session(link, session_id, type != 4, from, from_size, now_ns);
  if (drop != FG_DROP_COUNT) {
    return fg_drop_for(link, drop);
  }
  link->knows_poses = link->knows_poses || version == 3;
  if (type == 4) {
    fg_end_session(link);
    return FG_GOODBYE;
  }
  if (type == 2) {
    if (!fg_take_number(link, &link->queries, sequence)) {
      return FG_DROPPED;
    }
    link->query = query;
    return FG_QUERY;
  }
  if (!fg_take_number(link, &link->tool_states, sequence)) {
    return FG_DROPPED;
  }
  if (link->tool_state_seen && (int32_t)(sequence - link->tool_state.sequence) < 0) {
    return fg_drop_for(link, FG_DROP_LATE);
  }
  if (version == 1 && link->tool_state_seen) {
    fg_keep_pose(&state, &link->tool_state);
  } else if (version == 1) {
    fg_set_identity(state.orientation_WT);
  }
  link->tool_state_seen = 1;
  link->tool_state = state;
  return FG_TOOL_STATE;
}

/* Writes the datagram of a type's payload, sealed if there is a key. */
static inline size_t fg_finish(fg_link* link, unsigned char* datagram, size_t size, int64_t now_ns,
                               unsigned char* to) {
  size = fg_end_datagram(datagram, size);
  if (link->crypto == NULL) {
    memcpy(to, datagram, size);
    return size;
  }
  memcpy(to + FG_SEAL_HEAD_BYTES + FG_SEAL_TIMES_BYTES, datagram, size);
  return fg_seal(link, to, size, link->heard, link->heard_sent_ns, link->heard_received_ns, now_ns);
}

static inline int fg_torque_is_sound(const fg_force_sample* sample) {
  return fg_within(sample->torque_W_Nm, 3, 1e3) && fg_within(sample->orientation_WT, 4, 2.0) &&
         fg_is_unit(sample->orientation_WT) &&
         (!sample->has_rotational_stiffness ||
          fg_within(sample->rotational_stiffness_W_Nm_per_rad, 9, 1e7));
}

/* What version 3 has beyond the others, behind the stiffness. */
static inline void fg_put_torque(unsigned char* datagram, const fg_force_sample* sample) {
  double identity[4];
  fg_set_identity(identity);
  if (!sample->has_torque) {
    fg_put_doubles(datagram + 232, identity, 4);
    return;
  }
  fg_put(datagram + 44,
         fg_get(datagram + 44, 4) | 8u | (sample->has_rotational_stiffness ? 16u : 0u), 4);
  fg_put_doubles(datagram + 208, sample->torque_W_Nm, 3);
  fg_put_doubles(datagram + 232, sample->orientation_WT, 4);
  if (sample->has_rotational_stiffness) {
    fg_put_doubles(datagram + 264, sample->rotational_stiffness_W_Nm_per_rad, 9);
  }
}

/* Writes the datagram of a sample (or reply) to `to`, which has room for FG_MAX_DATAGRAM_BYTES.
 * @returns its size; 0 if there is no servo, or if the sample is not finite or out of range: the
 * servo would refuse it. */
static inline size_t fg_link_make_sample(fg_link* link, const fg_force_sample* sample,
                                         int64_t now_ns, unsigned char* to) {
  unsigned char datagram[FG_MAX_DATAGRAM_BYTES];
  size_t size;
  if (link->session_id == 0 || sample->echo_servo_time_ns < 0 ||
      !fg_within(sample->position_W_m, 3, 10.0) || !fg_within(sample->force_W_N, 3, 1000.0) ||
      !fg_within(sample->contact_point_W_m, 3, 10.0) ||
      !fg_within(&sample->relative_residual, 1, HUGE_VAL) || sample->relative_residual < 0.0 ||
      !fg_within(&sample->solve_time_s, 1, 3600.0) || sample->solve_time_s < 0.0 ||
      (sample->has_stiffness && !fg_within(sample->stiffness_W_N_per_m, 9, 1e7)) ||
      (sample->has_torque && !fg_torque_is_sound(sample)) ||
      (sample->has_rotational_stiffness && !sample->has_torque)) {
    return 0;
  }
  memset(datagram, 0, sizeof datagram);
  size =
      fg_begin_datagram(link, datagram, 3, link->knows_poses ? 312 : 184, ++link->sample_sequence);
  fg_put(datagram + 24, (uint64_t)sample->echo_servo_time_ns, 8);
  fg_put(datagram + 32, sample->echo_sequence, 4);
  fg_put(datagram + 36, sample->query_id, 4);
  fg_put(datagram + 40, sample->contact_epoch, 4);
  fg_put(datagram + 44,
         (sample->in_contact ? 1u : 0u) | (sample->converged ? 2u : 0u) |
             (sample->has_stiffness ? 4u : 0u),
         4);
  fg_put_doubles(datagram + 48, sample->position_W_m, 3);
  fg_put_doubles(datagram + 72, sample->force_W_N, 3);
  fg_put_doubles(datagram + 96, sample->contact_point_W_m, 3);
  fg_put_doubles(datagram + 120, &sample->relative_residual, 1);
  fg_put_doubles(datagram + 128, &sample->solve_time_s, 1);
  if (sample->has_stiffness) {
    fg_put_doubles(datagram + 136, sample->stiffness_W_N_per_m, 9);
  }
  if (link->knows_poses) {
    fg_put_torque(datagram, sample);
  }
  return fg_finish(link, datagram, size, now_ns, to);
}

static inline int fg_patch_is_sound(const fg_surface_patch* patch) {
  unsigned i;
  unsigned corner;
  if (patch->vertex_count > FG_PATCH_VERTICES || patch->triangle_count > FG_PATCH_TRIANGLES ||
      patch->echo_servo_time_ns < 0 || !fg_within(patch->position_W_m, 3, 10.0) ||
      !fg_floats_within(&patch->tool_radius_m, 1, (double)0.1f) || patch->tool_radius_m < 0.0f ||
      !fg_floats_within(&patch->tool_length_m, 1, 0.5) || patch->tool_length_m < 0.0f ||
      patch->tool_opening_crad > FG_PATCH_MAX_OPENING_CRAD ||
      (patch->has_stiffness && !fg_floats_within(patch->stiffness_W_N_per_m, 6, 1e7)) ||
      (patch->has_press_forces &&
       (patch->has_stiffness || !fg_floats_within(patch->press_forces_W_N[0], 3, 1000.0) ||
        !fg_floats_within(patch->press_forces_W_N[1], 3, 1000.0)))) {
    return 0;
  }
  for (i = 0; i < patch->vertex_count; ++i) {
    if (!fg_floats_within(patch->vertices_W_m[i], 3, 1.0)) {
      return 0;
    }
  }
  for (i = 0; i < patch->triangle_count; ++i) {
    for (corner = 0; corner < 3; ++corner) {
      if (patch->triangles[i][corner] >= patch->vertex_count) {
        return 0;
      }
    }
  }
  return 1;
}

/* The same for a patch of the surface, which a simulator need not send. */
static inline size_t fg_link_make_patch(fg_link* link, const fg_surface_patch* patch,
                                        int64_t now_ns, unsigned char* to) {
  unsigned char datagram[FG_MAX_DATAGRAM_BYTES];
  size_t size;
  unsigned i;
  if (link->session_id == 0 || !fg_patch_is_sound(patch)) {
    return 0;
  }
  memset(datagram, 0, sizeof datagram);
  size = fg_begin_datagram(link, datagram, 5, 385, ++link->patch_sequence);
  fg_put(datagram + 24, (uint64_t)patch->echo_servo_time_ns, 8);
  fg_put(datagram + 32, patch->echo_sequence, 4);
  fg_put(datagram + 36, patch->contact_epoch, 4);
  datagram[40] = (unsigned char)patch->vertex_count;
  datagram[41] = (unsigned char)patch->triangle_count;
  datagram[42] =
      (unsigned char)((patch->has_stiffness ? 1u : 0u) | (patch->has_press_forces ? 2u : 0u));
  datagram[43] = (unsigned char)patch->tool_opening_crad;
  fg_put_floats(datagram + 44, &patch->tool_radius_m, 1);
  fg_put_floats(datagram + 48, &patch->tool_length_m, 1);
  if (patch->has_stiffness) {
    fg_put_floats(datagram + 52, patch->stiffness_W_N_per_m, 6);
  } else if (patch->has_press_forces) {
    fg_put_floats(datagram + 52, patch->press_forces_W_N[0], 3);
    fg_put_floats(datagram + 64, patch->press_forces_W_N[1], 3);
  }
  fg_put_doubles(datagram + 76, patch->position_W_m, 3);
  for (i = 0; i < patch->vertex_count; ++i) {
    fg_put_floats(datagram + 100 + 12 * i, patch->vertices_W_m[i], 3);
  }
  for (i = 0; i < patch->triangle_count; ++i) {
    memcpy(datagram + 328 + 3 * i, patch->triangles[i], 3);
  }
  return fg_finish(link, datagram, size, now_ns, to);
}

/* Writes a goodbye: this simulator ends. @returns its size, 0 without a servo. */
static inline size_t fg_link_make_goodbye(fg_link* link, int64_t now_ns, unsigned char* to) {
  unsigned char datagram[FG_MAX_DATAGRAM_BYTES];
  if (link->session_id == 0) {
    return 0;
  }
  return fg_finish(link, datagram, fg_begin_datagram(link, datagram, 4, 0, 0), now_ns, to);
}

/* A sample for the tool's pose with the echo filled in; force zero, not in contact. */
static inline fg_force_sample fg_answer_to_tool_state(const fg_tool_state* state) {
  fg_force_sample sample;
  memset(&sample, 0, sizeof sample);
  sample.echo_sequence = state->sequence;
  sample.echo_servo_time_ns = state->servo_time_ns;
  memcpy(sample.position_W_m, state->position_W_m, sizeof sample.position_W_m);
  memcpy(sample.contact_point_W_m, state->position_W_m, sizeof sample.contact_point_W_m);
  memcpy(sample.orientation_WT, state->orientation_WT, sizeof sample.orientation_WT);
  return sample;
}

/* The same for a query. */
static inline fg_force_sample fg_answer_to_query(const fg_query* query) {
  fg_force_sample sample;
  memset(&sample, 0, sizeof sample);
  sample.query_id = query->query_id;
  sample.echo_servo_time_ns = query->servo_time_ns;
  memcpy(sample.position_W_m, query->position_W_m, sizeof sample.position_W_m);
  memcpy(sample.contact_point_W_m, query->position_W_m, sizeof sample.contact_point_W_m);
  fg_set_identity(sample.orientation_WT);
  return sample;
}

/* An empty patch for the tool's position with the echo filled in. */
static inline fg_surface_patch fg_patch_for_tool_state(const fg_tool_state* state) {
  fg_surface_patch patch;
  memset(&patch, 0, sizeof patch);
  patch.echo_sequence = state->sequence;
  patch.echo_servo_time_ns = state->servo_time_ns;
  memcpy(patch.position_W_m, state->position_W_m, sizeof patch.position_W_m);
  return patch;
}

#ifdef __cplusplus
}
#endif

/* NOLINTEND(bugprone-not-null-terminated-result) */
/* NOLINTEND(cppcoreguidelines-init-variables) */
/* NOLINTEND(modernize-use-using) */
/* NOLINTEND(modernize-use-nullptr) */
/* NOLINTEND(readability-identifier-naming) */
#endif /* FORCEGRID_LINK_H */
