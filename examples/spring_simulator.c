// SPDX-License-Identifier: Apache-2.0
/* A spring for Forcegrid, in C with link/forcegrid_link.h alone: F = -k (P - P0), with P0 where it
 * catches the tool near W's origin.
 * usage: spring_simulator_c PORT [STIFFNESS_N_PER_M [KEY_FILE]]
 * It needs no library. Compiled with FORCEGRID_WITH_SODIUM it also takes a key file. */
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "link/forcegrid_link.h"

#ifdef FORCEGRID_WITH_SODIUM
#include <sodium.h>
#include <sys/stat.h>

static int encrypt(void* key, unsigned char* to, const unsigned char* from, size_t size,
                   const unsigned char* head, size_t head_size, const unsigned char nonce[24]) {
  return crypto_aead_xchacha20poly1305_ietf_encrypt(to, NULL, from, size, head, head_size, NULL,
                                                    nonce, key) == 0;
}

static int decrypt(void* key, unsigned char* to, const unsigned char* from, size_t size,
                   const unsigned char* head, size_t head_size, const unsigned char nonce[24]) {
  return crypto_aead_xchacha20poly1305_ietf_decrypt(to, NULL, NULL, from, size, head, head_size,
                                                    nonce, key) == 0;
}

static int random_bytes(void* key, unsigned char* to, size_t size) {
  (void)key;
  randombytes_buf(to, size);
  return 1;
}

/* Reads a key file made by `forcegrid keygen`. @returns null, or what is wrong with it. */
static const char* load_key(const char* file, unsigned char* secret, unsigned char* id) {
  char line[104];
  size_t used = 0;
  struct stat status;
  int good;
  FILE* opened = fopen(file, "rb");
  if (opened == NULL) {
    return "it can't be opened; make one with 'forcegrid keygen FILE'";
  }
  if (fstat(fileno(opened), &status) != 0 || (status.st_mode & 077) != 0) {
    fclose(opened);
    return "others may use it; run: chmod 600 FILE";
  }
  good = fread(line, 1, sizeof line, opened) >= 102 &&
         memcmp(line, "forcegrid-link-key-1 ", 21) == 0 && line[37] == ' ' &&
         sodium_hex2bin(id, 8, line + 21, 16, NULL, &used, NULL) == 0 && used == 8 &&
         sodium_hex2bin(secret, 32, line + 38, 64, NULL, &used, NULL) == 0 && used == 32;
  fclose(opened);
  sodium_memzero(line, sizeof line);
  return good ? NULL : "it holds no key";
}
#endif

static const double kPeriod_s = 1.0 / 30.0;
static const double kReach_m = 0.005; /* the spring catches a tool this near to W's origin */

/* Reads the whole `text` as a number from `least` to `most`. @returns 1, or 0 if it is none. */
static int read_number(const char* text, double least, double most, double* number) {
  char* end;
  *number = strtod(text, &end);
  return end != text && *end == '\0' && *number >= least && *number <= most;
}

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

typedef struct {
  double stiffness_N_per_m;
  int held;            /* the spring has caught the tool */
  double first_W_m[3]; /* where: the spring is at rest there */
} spring;

static void touch(spring* object, const double* p) {
  if (!object->held && p[0] * p[0] + p[1] * p[1] + p[2] * p[2] < kReach_m * kReach_m) {
    object->held = 1;
    memcpy(object->first_W_m, p, sizeof object->first_W_m);
  }
}

static void pull(const spring* object, fg_force_sample* sample) {
  const double* p = sample->position_W_m;
  int i;
  sample->converged = 1;
  if (!object->held) {
    return;
  }
  sample->in_contact = sample->has_stiffness = 1;
  sample->contact_epoch = 1;
  memcpy(sample->contact_point_W_m, object->first_W_m, sizeof object->first_W_m);
  for (i = 0; i < 3; ++i) {
    sample->force_W_N[i] = -object->stiffness_N_per_m * (p[i] - object->first_W_m[i]);
    sample->stiffness_W_N_per_m[4 * i] = -object->stiffness_N_per_m;
  }
}

static void answer(int socket_number, fg_link* link, const spring* object, fg_force_sample sample,
                   const struct sockaddr_in* servo) {
  unsigned char bytes[FG_MAX_DATAGRAM_BYTES];
  size_t size;
  pull(object, &sample);
  size = fg_link_make_sample(link, &sample, now_ns(), bytes);
  if (size > 0) {
    sendto(socket_number, bytes, size, 0, (const struct sockaddr*)servo, sizeof *servo);
  }
}

/* Takes in everything that has arrived and answers the queries. @returns 1 for a new tool state. */
static int receive(int socket_number, fg_link* link, spring* object, struct sockaddr_in* servo) {
  unsigned char bytes[FG_MAX_DATAGRAM_BYTES + 1];
  unsigned char reply[FG_SEAL_OVERHEAD_BYTES];
  struct sockaddr_in from;
  int news = 0;
  for (;;) {
    socklen_t from_size = sizeof from;
    size_t reply_size;
    const ssize_t size = recvfrom(socket_number, bytes, sizeof bytes, MSG_DONTWAIT,
                                  (struct sockaddr*)&from, &from_size);
    fg_event event;
    if (size < 0) {
      return news;
    }
    event = fg_link_take(link, bytes, (size_t)size, &from, from_size, now_ns(), reply, &reply_size);
    if (reply_size > 0) {
      sendto(socket_number, reply, reply_size, 0, (struct sockaddr*)&from, from_size);
    }
    if (event == FG_DROPPED) {
      continue;
    }
    if (link->new_session || event == FG_GOODBYE) {
      object->held = news = 0;
    }
    if (event == FG_TOOL_STATE) {
      *servo = from;
      news = 1;
    } else if (event == FG_QUERY) {
      answer(socket_number, link, object, fg_answer_to_query(&link->query), &from);
    }
  }
}

static int serve(int socket_number, fg_link* link, spring* object) {
  struct sockaddr_in servo;
  struct pollfd readable = {socket_number, POLLIN, 0};
  const struct timespec period = {0, (long)(1e9 * kPeriod_s)};
  while (poll(&readable, 1, -1) >= 0) {
    if (receive(socket_number, link, object, &servo)) {
      touch(object, link->tool_state.position_W_m);
      answer(socket_number, link, object, fg_answer_to_tool_state(&link->tool_state), &servo);
    }
    nanosleep(&period, NULL);
  }
  return errno == EINTR ? 0 : 1;
}

int main(int argument_count, char** arguments) {
  static fg_link link;
  fg_crypto crypto;
  spring object = {100.0, 0, {0.0, 0.0, 0.0}};
  struct sockaddr_in address;
  socklen_t size = sizeof address;
  const int socket_number = socket(AF_INET, SOCK_DGRAM, 0);
  const int sealed = argument_count > 3;
  double port = 0.0;
  if (argument_count < 2 || !read_number(arguments[1], 0.0, 65535.0, &port) ||
      (argument_count > 2 && !read_number(arguments[2], 1e-3, 1e6, &object.stiffness_N_per_m))) {
    fprintf(stderr,
            "usage: spring_simulator_c PORT [STIFFNESS_N_PER_M [KEY_FILE]], with a port from 0 to "
            "65535 and a stiffness from 0.001 to 1e6\n");
    return 2;
  }
  memset(&crypto, 0, sizeof crypto);
#ifdef FORCEGRID_WITH_SODIUM
  static unsigned char secret[32];
  if (sodium_init() < 0) {
    fprintf(stderr, "libsodium can't start\n");
    return 1;
  }
  if (sealed) {
    const char* trouble = load_key(arguments[3], secret, crypto.key_id);
    if (trouble != NULL) {
      fprintf(stderr, "key file '%s': %s\n", arguments[3], trouble);
      return 1;
    }
  }
  crypto.context = secret;
  crypto.encrypt = encrypt;
  crypto.decrypt = decrypt;
  crypto.random_bytes = random_bytes;
#else
  if (sealed) {
    fprintf(stderr, "this program was built without libsodium and takes no key\n");
    return 2;
  }
#endif
  memset(&address, 0, sizeof address);
  address.sin_family = AF_INET;
  address.sin_port = htons((uint16_t)port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK); /* other machines only with a key */
  if (socket_number < 0 || bind(socket_number, (struct sockaddr*)&address, sizeof address) != 0 ||
      getsockname(socket_number, (struct sockaddr*)&address, &size) != 0) {
    perror("listen");
    return 1;
  }
  if (!fg_link_init(&link, 2.0, sealed ? &crypto : NULL)) {
    fprintf(stderr, "no random bytes\n");
    return 1;
  }
  printf("listening on 127.0.0.1:%d\n", ntohs(address.sin_port));
  fflush(stdout);
  return serve(socket_number, &link, &object);
}
