// SPDX-License-Identifier: Apache-2.0
// What the tool has in place of signatures where it was built without libsodium.
#include "cli/command/context.h"
#include "cli/input/signature.h"

namespace l4d::cli {

bool has_signatures() { return false; }
void require_signatures(const std::string& what) {
  throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                what + ": this build has no signatures (configure it with -DL4D_SIGNATURES=ON)");
}

PublicKey read_public_key(const std::string&) { return {}; }
SecretKey read_secret_key(const std::string&) { return {}; }
std::string key_text(const PublicKey&) { return {}; }
std::string public_key_line(const PublicKey&) { return {}; }
std::string secret_key_line(const SecretKey&) { return {}; }
KeyPair make_key_pair() { return {}; }
std::optional<FileSignature> check_signature(const std::string&) { return std::nullopt; }
PublicKey sign_file(const std::string&, const SecretKey&, const std::string&) { return {}; }

}  // namespace l4d::cli
