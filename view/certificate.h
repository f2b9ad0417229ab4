// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

struct ssl_ctx_st;  // OpenSSL's SSL_CTX

namespace forcegrid::view {

/// What a server needs for TLS: the private key and the certificate of one PEM file.
/// Real-time: no. Threads: one.
struct Certificate {
  struct Free {
    void operator()(ssl_ctx_st* context) const noexcept;
  };

  /// With key and certificates, for TLS 1.2 and later, without sessions that are resumed.
  std::unique_ptr<ssl_ctx_st, Free> context;
  std::string sha256;  ///< fingerprint of the server's own certificate, 64 hexadecimal digits
  /// The DNS names of its subjectAltName; of a certificate without one its common names. Only those
  /// that are is_certificate_name().
  std::vector<std::string> names;
};

/// Reads a file that holds a private key, its certificate and those that lead to a root, in PEM.
/// Nobody is ever asked for a passphrase.
/// @throws ViewError naming the file and the remedy if it can't be read, is not a regular file, is
/// open to anyone but its owner (mode beyond 0600), belongs to a user other than this one or root,
/// has no key or no certificate, if its key is encrypted or another certificate's, and if its
/// certificate is not valid now.
Certificate load_certificate(const std::string& file);

}  // namespace forcegrid::view
