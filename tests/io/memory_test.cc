// SPDX-License-Identifier: Apache-2.0
#include "io/file/memory.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

using testing::HasSubstr;

TEST(MemoryBudget, GivesBackWhatIsNotHeldAnyMore) {
  const MemoryBudget budget("--limit-memory", 1000);
  const Hold holder = budget.holder();
  std::shared_ptr<void> first = holder(600, "a");
  std::string message;
  EXPECT_EQ(test::status_of([&] { holder(401, "an image"); }, &message), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_THAT(message,
              HasSubstr("an image needs 401 bytes; of --limit-memory, 1.00 kB, 400 bytes"));
  EXPECT_EQ(budget.held(), 600U);
  std::shared_ptr<void> second = holder(400, "b");
  const std::shared_ptr<void> copy = first;
  first.reset();
  EXPECT_EQ(budget.held(), 1000U);
  second.reset();
  EXPECT_EQ(budget.held(), 600U);
  EXPECT_EQ(test::status_of([&] { holder(UINT64_MAX, "c"); }), L4D_ERR_LIMIT_EXCEEDED);
}

TEST(MemoryBudget, CountsNothingWithoutALimit) {
  const MemoryBudget budget("none", 0);
  EXPECT_EQ(budget.take(UINT64_MAX, "all"), nullptr);
  EXPECT_EQ(hold({}, UINT64_MAX, "all"), nullptr);
  EXPECT_EQ(budget.held(), 0U);
}

TEST(MemoryBudget, CountsAPipeBeforeItIsKept) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const std::string text(3000, 'x');
  ASSERT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  ::close(ends[1]);
  const MemoryBudget budget("--limit-memory", 1000);
  const std::string path = "/dev/fd/" + std::to_string(ends[0]);
  EXPECT_EQ(test::status_of([&] { InputFile file(path, budget.holder()); }),
            L4D_ERR_LIMIT_EXCEEDED);
  ::close(ends[0]);
}

// Bytes that values and their lists and keys have at least.
uint64_t size_of(const nlohmann::json& value) {
  uint64_t bytes = sizeof(value);
  for (auto item = value.begin(); value.is_structured() && item != value.end(); ++item) {
    bytes += size_of(*item) + (value.is_object() ? 48 + item.key().size() : 0);
  }
  return bytes;
}

TEST(JsonBytes, IsNoLessThanWhatIsMadeOfIt) {
  for (const std::string text :
       {"[1,2,3,4,5,6,7,8,9]", "{\"a\":1,\"b\":{\"c\":[]}}", "[[[[[[]]]]]]", "[{},{},{},{}]",
        "\"a text of some length, which is there twice\""}) {
    EXPECT_GE(json_bytes(text.data(), text.size(), 0), size_of(nlohmann::json::parse(text)))
        << text;
  }
  const std::string two = "[{},{}]";
  EXPECT_EQ(json_bytes(two.data(), two.size(), 100), json_bytes(two.data(), two.size(), 0) + 200);
}

}  // namespace
}  // namespace l4d::io
