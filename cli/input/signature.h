// SPDX-License-Identifier: Apache-2.0
// Signatures of whole files (spec: section "Signatures"), by libsodium where this build has it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace l4d::cli {

using PublicKey = std::array<unsigned char, 32>;
using SecretKey = std::array<unsigned char, 32>;  // the seed of RFC 8032

// Whether this build can sign and check; `what` is refused as unsupported where it cannot.
bool has_signatures();
void require_signatures(const std::string& what);

// A key in a file of one line. Throws Failure where the file holds none of its kind.
PublicKey read_public_key(const std::string& path);
SecretKey read_secret_key(const std::string& path);
std::string key_text(const PublicKey& key);  // hexadecimal
std::string public_key_line(const PublicKey& key);
std::string secret_key_line(const SecretKey& key);

struct KeyPair {
  SecretKey secret;
  PublicKey open;
};
KeyPair make_key_pair();

// The signature that a file ends with.
struct FileSignature {
  PublicKey key;
  bool right = false;  // it is that of the bytes before, by this key
};
// Nothing where a file ends without one. Reads the whole file.
std::optional<FileSignature> check_signature(const std::string& path);

// Writes the file `from`, less a signature that it ends with, and a signature by this key.
PublicKey sign_file(const std::string& from, const SecretKey& key, const std::string& to);

}  // namespace l4d::cli
