// SPDX-License-Identifier: Apache-2.0
#include "view/certificate.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

#include "text/secret_file.h"
#include "view/access.h"
#include "view/options.h"

namespace forcegrid::view {
namespace {

constexpr std::size_t kLargestFile = 256 << 10;  // a chain of certificates has some KiB

[[noreturn]] void fail(const std::string& file, const std::string& reason) {
  throw ViewError("view key file '" + file + "': " + reason);
}

[[noreturn]] void fail_with_errno(const std::string& file, const std::string& action, int error,
                                  const std::string& remedy = "") {
  fail(file, action + ": " + std::generic_category().message(error) + remedy);
}

std::string make_one() { return "make one with: " + std::string(command_for_key()); }

// OpenSSL's newest reason; its queue is empty afterwards.
std::string openssl_reason() {
  const unsigned long code = ::ERR_peek_last_error();
  const char* reason = ::ERR_reason_error_string(code);
  ::ERR_clear_error();
  return reason != nullptr ? reason : "error " + std::to_string(code);
}

// Whether a PEM block was looked for and there was none (or none more).
bool nothing_left() {
  const unsigned long code = ::ERR_peek_last_error();
  return ERR_GET_LIB(code) == ERR_LIB_PEM && ERR_GET_REASON(code) == PEM_R_NO_START_LINE;
}

// The file's bytes, wiped on destruction.
struct SecretText {
  std::string bytes{};
  SecretText() = default;
  ~SecretText() { ::OPENSSL_cleanse(bytes.data(), bytes.size()); }
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

template <auto kFree>
struct FreeWith {
  template <typename T>
  void operator()(T* it) const noexcept {
    kFree(it);
  }
};
using Memory = std::unique_ptr<BIO, FreeWith<::BIO_free_all>>;
using PrivateKey = std::unique_ptr<EVP_PKEY, FreeWith<::EVP_PKEY_free>>;
using X509Certificate = std::unique_ptr<X509, FreeWith<::X509_free>>;

void read_all(const std::string& file, SecretText& text) {
  const Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK));
  if (descriptor.number < 0) {
    const int error = errno;
    fail_with_errno(file, "open", error, error == ENOENT ? "; " + make_one() : "");
  }
  const std::string fault =
      text::fault_of_secret_file(file, descriptor.number, make_one(), "pose as the live view");
  if (!fault.empty()) {
    fail(file, fault);
  }
  text.bytes.resize(kLargestFile + 1);
  std::size_t size = 0;
  while (size < text.bytes.size()) {
    const ssize_t got =
        ::read(descriptor.number, text.bytes.data() + size, text.bytes.size() - size);
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
  if (size > kLargestFile) {
    fail(file,
         "has more than 256 KiB; a private key and its certificates need less: " + make_one());
  }
  text.bytes.resize(size);
}

Memory memory_of(const std::string& file, const SecretText& text) {
  Memory memory(::BIO_new_mem_buf(text.bytes.data(), static_cast<int>(text.bytes.size())));
  if (!memory) {
    fail(file, "no memory for it; end other programs");
  }
  return memory;
}

// In place of a question on the terminal.
int refuse_to_ask(char*, int, int, void* asked) {
  *static_cast<bool*>(asked) = true;
  return -1;
}

PrivateKey private_key(const std::string& file, const SecretText& text) {
  bool asked = false;
  const Memory memory = memory_of(file, text);
  PrivateKey key(::PEM_read_bio_PrivateKey(memory.get(), nullptr, refuse_to_ask, &asked));
  if (asked) {
    ::ERR_clear_error();
    fail(file,
         "its private key is encrypted, and nobody is asked for a passphrase; write it without "
         "one: openssl pkey -in " +
             text::shell_quoted(file) + " -out KEY.pem, and append the certificate to KEY.pem");
  }
  if (!key) {
    // OpenSSL gives the same reason for none as for one that it can't read.
    const bool missing = text.bytes.find("PRIVATE KEY-----") == std::string::npos;
    const std::string reason = openssl_reason();
    fail(file,
         missing ? "has no private key; append it, in PEM, or " + make_one()
                 : "its private key is damaged (" + reason + "); copy it again, or " + make_one());
  }
  return key;
}

// The next one; null: there is no more.
X509Certificate next_certificate(const std::string& file, BIO* memory) {
  X509Certificate certificate(::PEM_read_bio_X509(memory, nullptr, refuse_to_ask, nullptr));
  if (!certificate) {
    const bool missing = nothing_left();
    const std::string reason = openssl_reason();
    if (!missing) {
      fail(file,
           "a certificate in it is damaged (" + reason + "); copy it again, or " + make_one());
    }
  }
  return certificate;
}

std::string text_of(const ASN1_TIME* time) {
  const Memory memory(::BIO_new(::BIO_s_mem()));
  std::array<char, 64> text{};
  if (!memory || ::ASN1_TIME_print(memory.get(), time) != 1) {
    return "a time that is none";
  }
  const int size = ::BIO_read(memory.get(), text.data(), static_cast<int>(text.size()));
  return {text.data(), static_cast<std::size_t>(size > 0 ? size : 0)};
}

void check_times(const std::string& file, const X509* certificate) {
  const ASN1_TIME* begin = ::X509_get0_notBefore(certificate);
  const ASN1_TIME* end = ::X509_get0_notAfter(certificate);
  // Each is 0 for a time that can't be read.
  if (const int order = ::X509_cmp_current_time(begin); order >= 0) {
    fail(file, "its certificate is not valid before " + text_of(begin) +
                   "; set this machine's clock, or " + make_one());
  }
  if (const int order = ::X509_cmp_current_time(end); order <= 0) {
    fail(file, "its certificate has expired on " + text_of(end) + "; " + make_one());
  }
}

std::string sha256_of(const std::string& file, const X509* certificate) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  if (::X509_digest(certificate, ::EVP_sha256(), digest.data(), &size) != 1) {
    fail(file, "its certificate has no fingerprint: " + openssl_reason());
  }
  std::string digits;
  for (unsigned i = 0; i < size; ++i) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", static_cast<unsigned>(digest[i]));
    digits += two;
  }
  return digits;
}

std::string utf8_of(const ASN1_STRING* text) {
  unsigned char* bytes = nullptr;
  const int size = ::ASN1_STRING_to_UTF8(&bytes, text);
  const std::string copy =
      size > 0 ? std::string(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size))
               : "";
  ::OPENSSL_free(bytes);
  return copy;
}

std::vector<std::string> names_of(const X509* certificate) {
  std::vector<std::string> names;
  const auto take = [&names](const ASN1_STRING* text) {
    if (std::string name = utf8_of(text); is_certificate_name(name)) {
      names.push_back(std::move(name));
    }
  };
  int found = 0;  // -1: there is no such extension
  const std::unique_ptr<GENERAL_NAMES, FreeWith<::GENERAL_NAMES_free>> alternatives(
      static_cast<GENERAL_NAMES*>(
          ::X509_get_ext_d2i(certificate, NID_subject_alt_name, &found, nullptr)));
  if (alternatives) {
    for (int i = 0; i < sk_GENERAL_NAME_num(alternatives.get()); ++i) {
      const GENERAL_NAME* name = sk_GENERAL_NAME_value(alternatives.get(), i);
      if (name->type == GEN_DNS) {
        take(name->d.dNSName);
      }
    }
  } else if (found == -1) {
    const X509_NAME* subject = ::X509_get_subject_name(certificate);
    for (int at = -1; (at = ::X509_NAME_get_index_by_NID(subject, NID_commonName, at)) >= 0;) {
      take(::X509_NAME_ENTRY_get_data(::X509_NAME_get_entry(subject, at)));
    }
  }
  ::ERR_clear_error();
  return names;
}

}  // namespace

void Certificate::Free::operator()(ssl_ctx_st* context) const noexcept { ::SSL_CTX_free(context); }

Certificate load_certificate(const std::string& file) {
  SecretText text;
  read_all(file, text);
  ::ERR_clear_error();
  const PrivateKey key = private_key(file, text);
  const Memory memory = memory_of(file, text);
  const X509Certificate own = next_certificate(file, memory.get());
  if (!own) {
    fail(file, "has no certificate; append it, in PEM, or " + make_one());
  }
  if (::X509_check_private_key(own.get(), key.get()) != 1) {
    ::ERR_clear_error();
    fail(file,
         "its private key is not that of its first certificate; put the server's own certificate "
         "before the others, or " +
             make_one());
  }
  check_times(file, own.get());
  Certificate result{.context = std::unique_ptr<ssl_ctx_st, Certificate::Free>(
                         ::SSL_CTX_new(::TLS_server_method())),
                     .sha256 = sha256_of(file, own.get()),
                     .names = names_of(own.get())};
  SSL_CTX* context = result.context.get();
  if (context == nullptr || ::SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) != 1) {
    throw ViewError("OpenSSL does not start: " + openssl_reason() +
                    "; see the file that `openssl version -d` names");
  }
  ::SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION |
                                     SSL_OP_NO_TICKET | SSL_OP_CIPHER_SERVER_PREFERENCE);
  ::SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  ::SSL_CTX_set_num_tickets(context, 0);
  if (::SSL_CTX_use_certificate(context, own.get()) != 1 ||
      ::SSL_CTX_use_PrivateKey(context, key.get()) != 1) {
    fail(file, "OpenSSL refuses its certificate: " + openssl_reason() + "; " + make_one());
  }
  while (const X509Certificate more = next_certificate(file, memory.get())) {
    if (::SSL_CTX_add1_chain_cert(context, more.get()) != 1) {
      fail(file, "OpenSSL refuses a certificate after the first: " + openssl_reason() +
                     "; leave out those that do not lead to a root");
    }
  }
  return result;
}

}  // namespace forcegrid::view
