// SPDX-License-Identifier: Apache-2.0
// Digests of what a query gives (appendix F of the specification), as the contract of the suite
// prints them.
#pragma once

#include <string>

#include "l4d/decode.hpp"

namespace l4d {

// {"num_gaussians": N, "digests": {..}} of the form attributes.
std::string attribute_digests(const DecoderHandle& decoder, const l4d_query& query);
// The same of the form packed. Throws where the stream has none.
std::string packed_digests(const DecoderHandle& decoder, const l4d_query& query);

}  // namespace l4d
