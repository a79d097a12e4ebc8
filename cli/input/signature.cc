// SPDX-License-Identifier: Apache-2.0
#include "cli/input/signature.h"

#include <sodium.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "io/file/file.h"

namespace l4d::cli {
namespace {

constexpr unsigned char kMagic[4] = {'L', '4', 'D', 'S'};
constexpr size_t kKeyAt = sizeof(kMagic);
constexpr size_t kSignatureAt = kKeyAt + sizeof(PublicKey);
constexpr size_t kTrailerBytes = kSignatureAt + crypto_sign_BYTES;
static_assert(kTrailerBytes == 100 && sizeof(PublicKey) == crypto_sign_PUBLICKEYBYTES &&
              sizeof(SecretKey) == crypto_sign_SEEDBYTES);
constexpr const char* kPublicKind = "l4d-public-key ";
constexpr const char* kSecretKind = "l4d-secret-key ";

void start_library() {
  if (sodium_init() < 0) throw Failure(L4D_ERR_INTERNAL, "libsodium does not start");
}

// Secrets do not stay in memory that is given back.
struct FullSecretKey {
  unsigned char bytes[crypto_sign_SECRETKEYBYTES];
  PublicKey open;
  explicit FullSecretKey(const SecretKey& seed) {
    crypto_sign_seed_keypair(open.data(), bytes, seed.data());
  }
  ~FullSecretKey() { sodium_memzero(bytes, sizeof(bytes)); }
  FullSecretKey(const FullSecretKey&) = delete;
  FullSecretKey& operator=(const FullSecretKey&) = delete;
};

// A file's bytes in order, and the trailer that it ends with, if it looks like one.
class Contents {
 public:
  explicit Contents(const std::string& path) : path_(path) {
    io::InputFile file(path);
    size_ = file.size();
    if (size_ < kTrailerBytes) return;
    file.seek(size_ - kTrailerBytes);
    unsigned char trailer[kTrailerBytes];
    if (file.read(trailer, kTrailerBytes) != kTrailerBytes) fail();
    if (std::memcmp(trailer, kMagic, sizeof(kMagic)) != 0) return;
    trailer_.assign(trailer, trailer + kTrailerBytes);
  }

  bool has_trailer() const { return !trailer_.empty(); }
  const unsigned char* trailer() const { return trailer_.data(); }
  // Calls take(bytes, n) for all bytes before the trailer.
  template <typename Take>
  void for_content(const Take& take) {
    io::InputFile file(path_);
    for (uint64_t left = size_ - trailer_.size(); left > 0;) {
      const size_t n = read(file, left);
      take(buffer_.data(), n);
      left -= n;
    }
  }

 private:
  size_t read(io::InputFile& file, uint64_t most) {
    const size_t want = static_cast<size_t>(std::min<uint64_t>(buffer_.size(), most));
    if (file.read(buffer_.data(), want) != want) fail();
    check_interrupt();
    return want;
  }
  [[noreturn]] void fail() const { throw Failure(L4D_ERR_IO, path_ + ": the file became shorter"); }

  std::string path_;
  uint64_t size_ = 0;
  std::vector<unsigned char> trailer_;
  std::vector<unsigned char> buffer_ = std::vector<unsigned char>(size_t{1} << 20);
};

template <size_t kBytes>
std::array<unsigned char, kBytes> read_key(const std::string& path, const char* kind) {
  const std::vector<uint8_t> file = io::read_whole_file(path);
  std::string line(file.begin(), file.end());
  line.erase(line.find_last_not_of(" \t\r\n") + 1);
  const size_t prefix = std::strlen(kind);
  std::array<unsigned char, kBytes> key;
  size_t bytes = 0;
  const char* end = nullptr;
  const bool right = line.compare(0, prefix, kind) == 0 &&
                     sodium_hex2bin(key.data(), key.size(), line.data() + prefix,
                                    line.size() - prefix, nullptr, &bytes, &end) == 0 &&
                     bytes == kBytes && end == line.data() + line.size();
  sodium_memzero(line.data(), line.size());
  if (!right) {
    throw Failure(L4D_ERR_CORRUPT, path + ": no line of '" + kind + "' and " +
                                       std::to_string(2 * kBytes) + " hexadecimal digits");
  }
  return key;
}

template <size_t kBytes>
std::string hexadecimal(const std::array<unsigned char, kBytes>& bytes) {
  std::string text(2 * kBytes + 1, '\0');
  sodium_bin2hex(text.data(), text.size(), bytes.data(), bytes.size());
  text.pop_back();
  return text;
}

}  // namespace

bool has_signatures() { return true; }
void require_signatures(const std::string&) {}

PublicKey read_public_key(const std::string& path) {
  return read_key<sizeof(PublicKey)>(path, kPublicKind);
}
SecretKey read_secret_key(const std::string& path) {
  return read_key<sizeof(SecretKey)>(path, kSecretKind);
}
std::string key_text(const PublicKey& key) { return hexadecimal(key); }
std::string public_key_line(const PublicKey& key) { return kPublicKind + hexadecimal(key) + "\n"; }
std::string secret_key_line(const SecretKey& key) { return kSecretKind + hexadecimal(key) + "\n"; }

KeyPair make_key_pair() {
  start_library();
  KeyPair pair;
  randombytes_buf(pair.secret.data(), pair.secret.size());
  pair.open = FullSecretKey(pair.secret).open;
  return pair;
}

std::optional<FileSignature> check_signature(const std::string& path) {
  start_library();
  Contents contents(path);
  if (!contents.has_trailer()) return std::nullopt;
  crypto_sign_state state;
  crypto_sign_init(&state);
  contents.for_content(
      [&](const unsigned char* bytes, size_t n) { crypto_sign_update(&state, bytes, n); });
  const unsigned char* trailer = contents.trailer();
  crypto_sign_update(&state, trailer, kSignatureAt);
  FileSignature found;
  std::copy_n(trailer + kKeyAt, found.key.size(), found.key.data());
  found.right = crypto_sign_final_verify(&state, trailer + kSignatureAt, found.key.data()) == 0;
  return found;
}

PublicKey sign_file(const std::string& from, const SecretKey& key, const std::string& to) {
  start_library();
  const FullSecretKey full(key);
  Contents contents(from);
  io::OutputFile out(to);
  crypto_sign_state state;
  crypto_sign_init(&state);
  const auto add = [&](const unsigned char* bytes, size_t n) {
    crypto_sign_update(&state, bytes, n);
    out.write(bytes, n);
  };
  contents.for_content(add);
  add(kMagic, sizeof(kMagic));
  add(full.open.data(), full.open.size());
  unsigned char signature[crypto_sign_BYTES];
  crypto_sign_final_create(&state, signature, nullptr, full.bytes);
  out.write(signature, sizeof(signature));
  out.commit();
  return full.open;
}

}  // namespace l4d::cli
