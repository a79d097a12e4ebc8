// SPDX-License-Identifier: Apache-2.0
// Mutants of small files by the thousand. L4D_MUTANTS sets how many, and L4D_VERB_MUTANTS how many
// meet every verb; a long run takes a million of each.
// L4D_MUTANTS_SEED, 0 unless told, makes them others: so that processes can share a long run.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>

#include "tests/common/codec.h"
#include "tests/decoder/allocation_meter.h"
#include "tests/hostile/chunk_walk.h"
#include "tests/hostile/mutate.h"
#include "tests/hostile/session.h"
#include "tests/hostile/small_files.h"
#include "tests/hostile/verbs.h"

namespace l4d {
namespace {

using namespace test;

constexpr uint64_t kDefaultMutants = 20000;
// Working memory of a thread, handle and strings, beside what is charged to the limit.
constexpr uint64_t kUncharged = uint64_t{4} << 20;

uint64_t from_environment(const char* name, uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

uint64_t mutants() { return from_environment("L4D_MUTANTS", kDefaultMutants); }
uint64_t verb_mutants() { return from_environment("L4D_VERB_MUTANTS", kDefaultMutants / 10); }

// Three generators for each seed, one for each test of mutants.
uint64_t seed(uint64_t test) { return 41 + 3 * from_environment("L4D_MUTANTS_SEED", 0) + test; }

// Where a failing mutant can be found again.
std::string keep(const Bytes& mutant) {
  const std::string path = temporary_path(".l4d");
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(mutant.data()),
             static_cast<std::streamsize>(mutant.size()));
  return path;
}

// Whether something that the whole file refers to is not as it was.
bool is_damaged(const Bytes& whole, const std::vector<ChunkPlace>& places, const Bytes& mutant) {
  return std::any_of(places.begin(), places.end(), [&](const ChunkPlace& p) {
    return p.offset + p.bytes > mutant.size() ||
           !std::equal(whole.begin() + static_cast<std::ptrdiff_t>(p.offset),
                       whole.begin() + static_cast<std::ptrdiff_t>(p.offset + p.bytes),
                       mutant.begin() + static_cast<std::ptrdiff_t>(p.offset));
  });
}

TEST(SmallFiles, AreSoundAndUseEveryTool) {
  uint32_t tools = 0;
  Session session;
  for (const SmallFile& file : small_files()) {
    SCOPED_TRACE(file.name);
    for (const Violation& v : validate(file.bytes)) ADD_FAILURE() << v.clause << " " << v.message;
    EXPECT_EQ(session.use(file.bytes), L4D_OK);
    EXPECT_LT(file.bytes.size(), 12000u);
    DecoderHandle d;
    d.open_memory(file.bytes.data(), file.bytes.size());
    tools |= d.info().tools;
    // The walk finds every byte that is not padding.
    size_t covered = 0;
    for (const ChunkPlace& p : chunk_places(file.bytes)) covered += p.bytes;
    EXPECT_LE(covered, file.bytes.size());
    EXPECT_GT(covered + 64, file.bytes.size());
    Bytes repaired = file.bytes;
    repair_checksums(repaired);
    EXPECT_EQ(repaired, file.bytes);
  }
  const uint32_t all = L4D_TOOL_MOTION | L4D_TOOL_TEMPORAL_OPACITY | L4D_TOOL_VIEW_DEPENDENCE |
                       L4D_TOOL_RESIDUAL_STAGES | L4D_TOOL_ESCAPES | L4D_TOOL_RCQ |
                       L4D_TOOL_LOSSLESS | L4D_TOOL_TRANSFORM | L4D_TOOL_RANS | L4D_TOOL_SH_BASE;
  EXPECT_EQ(tools & all, all);
}

// spec: CHNK-2
TEST(Mutants, DamageUnderChecksumsIsAlwaysNoticed) {
  Random random(seed(0));
  Session session;
  struct Whole {
    std::vector<ChunkPlace> places;
    uint64_t digest = 0;
  };
  std::vector<Whole> wholes;
  for (const SmallFile& file : small_files()) {
    Whole w{chunk_places(file.bytes), 0};
    ASSERT_EQ(session.decode_all(file.bytes, &w.digest), L4D_OK);
    wholes.push_back(std::move(w));
  }
  uint64_t noticed = 0, harmless = 0;
  for (uint64_t i = 0; i < mutants() / 2; ++i) {
    const size_t f = static_cast<size_t>(i % small_files().size());
    const Bytes& whole = small_files()[f].bytes;
    Bytes mutant = whole;
    for (uint32_t k = 0, n = 1 + random.below(3); k < n; ++k) mutate_bytes(mutant, random);
    uint64_t digest = 0;
    const l4d_status status = session.decode_all(mutant, &digest);
    if (is_damaged(whole, wholes[f].places, mutant)) {
      ASSERT_TRUE(is_refusal(status)) << l4d_status_name(status) << ", kept as " << keep(mutant);
      ++noticed;
    } else {
      ASSERT_EQ(status, L4D_OK) << "kept as " << keep(mutant);
      ASSERT_EQ(digest, wholes[f].digest) << "kept as " << keep(mutant);
      ++harmless;
    }
  }
  EXPECT_GT(noticed, harmless);
  RecordProperty("noticed", std::to_string(noticed));
  RecordProperty("harmless", std::to_string(harmless));
}

// Any status will do that blames the stream; memory is held to its limit.
TEST(Mutants, DamageUnderRepairedChecksumsIsSafe) {
  Random random(seed(1));
  Session session;
  std::map<l4d_status, uint64_t> seen;
  for (uint64_t i = 0; i < mutants() / 2; ++i) {
    const SmallFile& file = small_files()[static_cast<size_t>(i % small_files().size())];
    Bytes mutant = file.bytes;
    mutate_stream(mutant, random);
    const AllocationMeter meter;
    const l4d_status status = session.use(mutant);
    ++seen[status];
    ASSERT_TRUE(status == L4D_OK || is_refusal(status))
        << l4d_status_name(status) << ", kept as " << keep(mutant);
    if (i % 4 == 0) {
      const l4d_reader reader = memory_reader(mutant);
      const l4d_decoder_options options = session_options();
      uint64_t violations = 0;
      const l4d_status checked = l4d_validate(&reader, &options, nullptr, nullptr, &violations);
      ASSERT_TRUE(checked == L4D_OK || checked == L4D_ERR_LIMIT_EXCEEDED)
          << l4d_status_name(checked) << ", kept as " << keep(mutant);
      // A decoder notices nothing that a validator overlooks.
      if (checked == L4D_OK && violations == 0) {
        ASSERT_EQ(status, L4D_OK) << "kept as " << keep(mutant);
      }
    }
    ASSERT_LT(meter.peak(), kSessionMemory + kUncharged) << "kept as " << keep(mutant);
  }
  // Neither are all refused at the door nor does all damage go unnoticed.
  EXPECT_GT(seen[L4D_OK], mutants() / 40);
  EXPECT_GT(seen[L4D_ERR_CORRUPT], mutants() / 40);
  for (const auto& [status, count] : seen) {
    RecordProperty(l4d_status_name(status), std::to_string(count));
  }
}

// A file of members, one of which is a mutant whose checksums are right.
Bytes mutant_of_members(const std::vector<Bytes>& members, Random& random) {
  const size_t hurt = random.below(static_cast<uint32_t>(members.size()));
  Bytes out;
  for (size_t i = 0; i < members.size(); ++i) {
    Bytes member = members[i];
    if (i == hurt) mutate_stream(member, random);
    out.insert(out.end(), member.begin(), member.end());
  }
  return out;
}

// Every verb refuses a mutant or takes it; what repair keeps of it is valid and decodes.
TEST(Mutants, UnderRepairedChecksumsMeetEveryVerb) {
  Random random(seed(2));
  const Bytes first = chain({&small_files()[0].bytes});
  // The first member, and what follows it.
  const Bytes both = chain({&small_files()[0].bytes, &small_files()[8].bytes});
  const auto split = static_cast<std::ptrdiff_t>(first.size());
  const std::vector<Bytes> members = {Bytes(both.begin(), both.begin() + split),
                                      Bytes(both.begin() + split, both.end())};
  ASSERT_TRUE(validate(both).empty());
  std::map<std::string, uint64_t> taken, refused;
  for (uint64_t i = 0; i < verb_mutants(); ++i) {
    const size_t kind = static_cast<size_t>(i % (small_files().size() + 1));
    Bytes mutant;
    if (kind == small_files().size()) {
      mutant = mutant_of_members(members, random);
    } else {
      mutant = small_files()[kind].bytes;
      mutate_stream(mutant, random);
    }
    for (const VerbOutcome& outcome : try_verbs(mutant, first)) {
      ASSERT_EQ(outcome.fault, "") << outcome.verb << ", kept as " << keep(mutant);
      ++(outcome.status == L4D_OK ? taken : refused)[outcome.verb];
    }
  }
  for (const char* verb : {"validate", "info", "remux", "cut", "concat", "repair", "compare"}) {
    EXPECT_GT(taken[verb], 0u) << verb;
    RecordProperty(verb, std::to_string(taken[verb]) + " taken, " + std::to_string(refused[verb]) +
                             " refused");
  }
}

}  // namespace
}  // namespace l4d
