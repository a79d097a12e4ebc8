// SPDX-License-Identifier: Apache-2.0
// Files of every tool, cut at every length.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/common/codec.h"
#include "tests/hostile/chunk_walk.h"
#include "tests/hostile/session.h"
#include "tests/hostile/small_files.h"

namespace l4d {
namespace {

using namespace test;

// spec: CHNK-1
TEST(Truncation, NoPartIsEverTakenForTheWhole) {
  Session session;
  for (const SmallFile& file : small_files()) {
    SCOPED_TRACE(file.name);
    size_t end = 0;  // of the last byte that something refers to
    for (const ChunkPlace& p : chunk_places(file.bytes)) end = std::max(end, p.offset + p.bytes);
    uint64_t whole = 0, digest = 0;
    ASSERT_EQ(session.decode_all(file.bytes, &whole), L4D_OK);
    for (size_t n = 0; n < file.bytes.size(); ++n) {
      // A buffer of its own, so that a sanitizer sees a read beyond the cut.
      const Bytes cut(file.bytes.begin(), file.bytes.begin() + static_cast<std::ptrdiff_t>(n));
      const l4d_status status = session.decode_all(cut, &digest);
      if (n < end) {
        ASSERT_EQ(status, n == 0 ? L4D_ERR_NOT_L4D : L4D_ERR_TRUNCATED) << n;
      } else {
        ASSERT_EQ(status, L4D_OK) << n;
        ASSERT_EQ(digest, whole) << n;
      }
    }
  }
}

// What an instant needs may be there while the rest is not; then it is shown as it is in the whole.
TEST(Truncation, AnInstantIsRightOrRefused) {
  for (const SmallFile& file : small_files()) {
    SCOPED_TRACE(file.name);
    DecoderHandle d;
    d.open_memory(file.bytes.data(), file.bytes.size());
    const double time = 0.5 * d.info().duration;
    const SplatArrays whole = d.slice(time);
    size_t shown = 0;
    for (size_t n = 0; n < file.bytes.size(); n += 3) {
      const Bytes cut(file.bytes.begin(), file.bytes.begin() + static_cast<std::ptrdiff_t>(n));
      try {
        d.open_memory(cut.data(), cut.size());
        const SplatArrays part = d.slice(time);
        ASSERT_TRUE(same_bits(part, whole)) << n;
        ++shown;
      } catch (const Error& e) {
        ASSERT_TRUE(e.status() == L4D_ERR_TRUNCATED || e.status() == L4D_ERR_NOT_L4D) << e.what();
      }
    }
    EXPECT_LT(shown, file.bytes.size() / 3);
  }
}

}  // namespace
}  // namespace l4d
