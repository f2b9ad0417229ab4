// SPDX-License-Identifier: Apache-2.0
#include "link/key.h"

#include <fcntl.h>
#include <sodium.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>

#include "text/secret_file.h"

namespace forcegrid::link {
namespace {

static_assert(kKeyBytes == crypto_aead_xchacha20poly1305_ietf_KEYBYTES);

constexpr std::string_view kTag = "forcegrid-link-key-1";
constexpr std::string_view kIdContext = "forcegrid link key id";
constexpr std::size_t kIdDigits = 2 * std::tuple_size_v<KeyId>;
constexpr std::size_t kSecretDigits = 2 * kKeyBytes;
constexpr std::size_t kLineBytes = kTag.size() + 1 + kIdDigits + 1 + kSecretDigits + 1;
constexpr mode_t kOwnerOnly = S_IRUSR | S_IWUSR;

[[noreturn]] void fail(const std::string& file, const std::string& reason) {
  throw LinkError("link key file '" + file + "': " + reason);
}

[[noreturn]] void fail_with_errno(const std::string& file, const std::string& action, int error) {
  fail(file, action + ": " + std::generic_category().message(error));
}

/// Text that holds the secret; wiped on destruction.
struct SecretText {
  std::array<char, kLineBytes + 1> bytes{};  // one more, to see that a file is too long
  SecretText() = default;
  ~SecretText() { ::sodium_memzero(bytes.data(), bytes.size()); }
  SecretText(const SecretText&) = delete;
  SecretText& operator=(const SecretText&) = delete;
};

struct Descriptor {
  int number;
  explicit Descriptor(int descriptor) : number(descriptor) {}
  ~Descriptor() { ::close(number); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
};

void start_library() {
  if (::sodium_init() < 0) {
    throw LinkError("link key: libsodium could not start; reinstall the package libsodium23");
  }
}

void check_owner_and_mode(const std::string& file, int descriptor) {
  const std::string fault = text::fault_of_secret_file(
      file, descriptor, "make one with 'forcegrid keygen FILE'", "move the motors");
  if (!fault.empty()) {
    fail(file, fault);
  }
}

std::size_t read_all(const std::string& file, int descriptor, SecretText& text) {
  std::size_t size = 0;
  while (size < text.bytes.size()) {
    const ssize_t got = ::read(descriptor, text.bytes.data() + size, text.bytes.size() - size);
    if (got < 0 && errno == EINTR) {
      continue;
    }
    if (got < 0) {
      fail_with_errno(file, "read", errno);
    }
    if (got == 0) {
      break;
    }
    size += static_cast<std::size_t>(got);
  }
  return size;
}

void write_all(const std::string& file, int descriptor, const SecretText& text) {
  std::size_t written = 0;
  while (written < kLineBytes) {
    const ssize_t put = ::write(descriptor, text.bytes.data() + written, kLineBytes - written);
    if (put < 0 && errno != EINTR) {
      const int error = errno;
      ::unlink(file.c_str());
      fail_with_errno(file, "write", error);
    }
    written += put > 0 ? static_cast<std::size_t>(put) : 0;
  }
  if (::fsync(descriptor) != 0) {
    const int error = errno;
    ::unlink(file.c_str());
    fail_with_errno(file, "write to the disk", error);
  }
}

bool read_hex(std::string_view digits, unsigned char* bytes, std::size_t size) {
  std::size_t used = 0;
  return ::sodium_hex2bin(bytes, size, digits.data(), digits.size(), nullptr, &used, nullptr) ==
             0 &&
         used == size;
}

}  // namespace

std::string to_string(const KeyId& id) {
  std::array<char, kIdDigits + 1> digits{};
  ::sodium_bin2hex(digits.data(), digits.size(), reinterpret_cast<const unsigned char*>(id.data()),
                   id.size());
  return digits.data();
}

void LinkKey::Wipe::operator()(unsigned char* secret) const noexcept { ::sodium_free(secret); }

LinkKey::Secret LinkKey::reserve() {
  start_library();
  Secret secret(static_cast<unsigned char*>(::sodium_malloc(kKeyBytes)));
  if (!secret) {
    throw LinkError("link key: no protected memory for it: " +
                    std::generic_category().message(errno) + "; end other programs");
  }
  return secret;
}

LinkKey::LinkKey(Secret secret) : secret_(std::move(secret)) {
  std::array<unsigned char, 16> digest{};
  ::crypto_generichash(digest.data(), digest.size(),
                       reinterpret_cast<const unsigned char*>(kIdContext.data()), kIdContext.size(),
                       secret_.get(), kKeyBytes);
  std::memcpy(id_.data(), digest.data(), id_.size());
  ::sodium_mprotect_readonly(secret_.get());
}

LinkKey::LinkKey(const std::array<std::byte, kKeyBytes>& secret)
    : LinkKey([&] {
        Secret own = reserve();
        std::memcpy(own.get(), secret.data(), kKeyBytes);
        return own;
      }()) {}

LinkKey LinkKey::load(const std::string& file) {
  const Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK));
  if (descriptor.number < 0) {
    const int error = errno;
    fail(file, "open: " + std::generic_category().message(error) +
                   (error == ENOENT ? "; make a key with 'forcegrid keygen FILE' and copy it to "
                                      "both machines"
                                    : ""));
  }
  check_owner_and_mode(file, descriptor.number);
  Secret secret = reserve();
  SecretText text;
  const std::size_t size = read_all(file, descriptor.number, text);
  const std::string_view line(text.bytes.data(), std::min(size, kLineBytes));
  KeyId stated_id{};
  const std::size_t id_at = kTag.size() + 1;
  const std::size_t secret_at = id_at + kIdDigits + 1;
  if (size != kLineBytes || !line.starts_with(kTag) || line[kTag.size()] != ' ' ||
      line[secret_at - 1] != ' ' || line.back() != '\n' ||
      !read_hex(line.substr(id_at, kIdDigits), reinterpret_cast<unsigned char*>(stated_id.data()),
                stated_id.size()) ||
      !read_hex(line.substr(secret_at, kSecretDigits), secret.get(), kKeyBytes)) {
    fail(file, "holds no key; it must be the one line that 'forcegrid keygen FILE' writes");
  }
  LinkKey key(std::move(secret));
  if (key.id() != stated_id) {
    fail(file, "is damaged: its secret does not have the id that it states (" +
                   to_string(stated_id) + "); copy it again from the other machine");
  }
  return key;
}

KeyId LinkKey::generate(const std::string& file) {
  Secret secret = reserve();
  ::randombytes_buf(secret.get(), kKeyBytes);
  const LinkKey key(std::move(secret));
  const Descriptor descriptor(
      ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, kOwnerOnly));
  if (descriptor.number < 0) {
    if (errno == EEXIST) {
      fail(file,
           "exists and is not overwritten; choose another name, or remove it if no machine "
           "uses its key any more");
    }
    fail_with_errno(file, "create", errno);
  }
  // The umask may only have taken rights away; a file system without modes would leave too many.
  check_owner_and_mode(file, descriptor.number);
  SecretText text;
  char* to = std::copy(kTag.begin(), kTag.end(), text.bytes.data());
  *to++ = ' ';
  ::sodium_bin2hex(to, kIdDigits + 1, reinterpret_cast<const unsigned char*>(key.id().data()),
                   key.id().size());
  to += kIdDigits;
  *to++ = ' ';
  ::sodium_bin2hex(to, kSecretDigits + 1, key.secret(), kKeyBytes);
  to[kSecretDigits] = '\n';
  write_all(file, descriptor.number, text);
  return key.id();
}

std::vector<LinkKey> load_keys(const std::vector<std::string>& files) {
  std::vector<LinkKey> keys;
  keys.reserve(files.size());
  for (const std::string& file : files) {
    keys.push_back(LinkKey::load(file));
  }
  return keys;
}

}  // namespace forcegrid::link
