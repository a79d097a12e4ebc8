// SPDX-License-Identifier: Apache-2.0
#include "io/file/safetensors.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>

#include "tests/common/safetensors.h"

namespace l4d::io {
namespace {

using test::safetensors_file;
using Values = std::vector<std::vector<float>>;

// Two tensors, whose places are not in the order of their names, with 4 bytes between them.
const char kHeader[] =
    R"({"__metadata__":{"format":"pt"},"a":{"dtype":"F32","shape":[2,1],"data_offsets":[16,24]},)"
    R"("b":{"dtype":"F32","shape":[3],"data_offsets":[0,12]},"c":{"dtype":"I64","shape":[1],"data_offsets":[16,24]}})";
const std::vector<float> kValues = {1, 2, 3, 4, -5.5f, 1e-40f};

TensorFile open(std::vector<uint8_t> bytes) {
  return TensorFile(InputFile("weights", std::move(bytes)));
}

void expect_failure(l4d_status status, const std::string& message, const std::function<void()>& f) {
  try {
    f();
    ADD_FAILURE() << "nothing is thrown; expected: " << message;
  } catch (const Error& error) {
    EXPECT_EQ(error.status(), status) << error.what();
    EXPECT_THAT(error.what(), testing::HasSubstr(message));
  }
}

TEST(TensorFile, CountsItsHeader) {
  const MemoryBudget small("--limit-memory", 1000), enough("--limit-memory", 100000);
  const auto read = [](const Hold& holder) {
    return TensorFile(InputFile("weights", safetensors_file(kHeader, kValues)), holder);
  };
  expect_failure(L4D_ERR_LIMIT_EXCEEDED, "its header needs", [&] { read(small.holder()); });
  EXPECT_EQ(read(enough.holder()).read({{"a", {2, 1}}}), (Values{{-5.5f, 1e-40f}}));
}

TEST(TensorFile, ReadsTensorsByName) {
  TensorFile file = open(safetensors_file(kHeader, kValues));
  ASSERT_NE(file.shape_of("a"), nullptr);
  EXPECT_EQ(*file.shape_of("a"), (std::vector<uint64_t>{2, 1}));
  EXPECT_EQ(file.shape_of("d"), nullptr);
  EXPECT_EQ(file.shape_of("__metadata__"), nullptr);
  EXPECT_EQ(file.read({{"a", {2, 1}}, {"b", {3}}}), (Values{{-5.5f, 1e-40f}, {1, 2, 3}}));
}

TEST(TensorFile, RefusesTensorsThatAreNotAsWanted) {
  const auto read = [](std::vector<TensorName> wanted) {
    return [wanted] { open(safetensors_file(kHeader, kValues)).read(wanted); };
  };
  expect_failure(L4D_ERR_CORRUPT, "there is no tensor d", read({{"d", {1}}}));
  expect_failure(L4D_ERR_CORRUPT, "a has the shape [2, 1]; it must be [2]", read({{"a", {2}}}));
  expect_failure(L4D_ERR_FEATURE_UNSUPPORTED, "c is of type I64; it must be F32",
                 read({{"c", {1}}}));
  expect_failure(L4D_ERR_CORRUPT, "shares bytes", read({{"b", {3}}, {"b", {3}}}));
  std::vector<float> wrong = kValues;
  wrong[1] = std::nanf("");
  expect_failure(L4D_ERR_CORRUPT, "value 1 of b is not finite", [&] {
    open(safetensors_file(kHeader, wrong)).read({{"b", {3}}});
  });
}

TEST(TensorFile, RefusesWrongHeaders) {
  const auto header = [](const std::string& text) {
    return [text] { open(safetensors_file(text, {1, 2})); };
  };
  const auto tensor = [&](const std::string& shape, const std::string& offsets) {
    return header(R"({"a":{"dtype":"F32","shape":)" + shape + R"(,"data_offsets":)" + offsets +
                  "}}");
  };
  tensor("[2]", "[0,8]")();
  expect_failure(L4D_ERR_CORRUPT, "not an object", header("[1]"));
  expect_failure(L4D_ERR_CORRUPT, "byte 8: the header: ", header("{\"a\":"));
  expect_failure(L4D_ERR_CORRUPT, "dtype, shape and data_offsets of a", header(R"({"a":1})"));
  expect_failure(L4D_ERR_CORRUPT, "dtype, shape and data_offsets of a", tensor("[-1]", "[0,8]"));
  expect_failure(L4D_ERR_CORRUPT, "dtype, shape and data_offsets of a", tensor("[1.5]", "[0,8]"));
  expect_failure(L4D_ERR_CORRUPT, "dtype, shape and data_offsets of a", tensor("2", "[0,8]"));
  expect_failure(L4D_ERR_CORRUPT, "dtype, shape and data_offsets of a",
                 tensor("[1,1,1,1,1,1,1,1,2]", "[0,8]"));
  expect_failure(L4D_ERR_CORRUPT, "data_offsets of a are [0, 9]", tensor("[2]", "[0,9]"));
  expect_failure(L4D_ERR_CORRUPT, "data_offsets of a are [8, 0]", tensor("[2]", "[8,0]"));
  expect_failure(L4D_ERR_CORRUPT, "data_offsets of a are [0]", tensor("[2]", "[0]"));
}

// The product of a shape wraps around 2^64 to the bytes that are there.
TEST(TensorFile, RefusesShapesThatDoNotFitTheirBytes) {
  const auto read = [](const std::string& shape, const std::vector<uint64_t>& wanted) {
    return [shape, wanted] {
      open(safetensors_file(
               R"({"a":{"dtype":"F32","shape":)" + shape + R"(,"data_offsets":[0,8]}})", {1, 2}))
          .read({{"a", wanted}});
    };
  };
  expect_failure(L4D_ERR_CORRUPT, "8 bytes, which do not fit", read("[3]", {3}));
  expect_failure(L4D_ERR_CORRUPT, "8 bytes, which do not fit", read("[1]", {1}));
  expect_failure(L4D_ERR_CORRUPT, "8 bytes, which do not fit", read("[0]", {0}));
  const uint64_t large = uint64_t{1} << 32;
  expect_failure(L4D_ERR_CORRUPT, "8 bytes, which do not fit",
                 read("[4294967296,4294967296]", {large, large}));
}

// Every beginning of a file is refused, and so is a header that says that it is longer than the
// file.
TEST(TensorFile, RefusesFilesThatEndEarly) {
  const std::vector<uint8_t> whole = safetensors_file(kHeader, kValues);
  for (size_t n = 0; n < whole.size(); ++n) {
    EXPECT_THROW(open({whole.begin(), whole.begin() + static_cast<ptrdiff_t>(n)}), Error) << n;
  }
  std::vector<uint8_t> huge = whole;
  for (size_t k = 0; k < 8; ++k) huge[k] = 0xff;
  expect_failure(L4D_ERR_CORRUPT, "the header has 18446744073709551615 bytes", [&] { open(huge); });
}

}  // namespace
}  // namespace l4d::io
