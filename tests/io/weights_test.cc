// SPDX-License-Identifier: Apache-2.0
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class WeightsTest : public test::IoTest {
 protected:
  l4d_status status(const std::string& bytes) const {
    const std::string file = write("w.ply", bytes);
    return test::status_of([&] { read_weights_ply(file); });
  }
};

TEST_F(WeightsTest, ColumnsByName) {
  const std::string file = write(
      "w.ply", test::ply_header("ascii", {"l4d_weights 1"}, 2,
                                {"weight_scale", "unknown", "alpha_t", "weight_sh_gradient"}) +
                   "1 9 0.5 0.25\n2 9 1e-9 0\n");
  const Weights weights = read_weights_ply(file);
  EXPECT_EQ(weights.count, 2U);
  EXPECT_EQ(weights.alpha_t, (std::vector<float>{0.5F, 1e-9F}));
  EXPECT_EQ(weights.sh, (std::vector<float>{0.25F, 0}));
  EXPECT_EQ(weights.scale, (std::vector<float>{1, 2}));
  EXPECT_TRUE(weights.rotor_spatial.empty());
  EXPECT_TRUE(weights.rotor_temporal.empty());
}

TEST_F(WeightsTest, BadFiles) {
  EXPECT_EQ(status(test::ply_header("ascii", {}, 1, {"alpha_t"}) + "1\n"), L4D_ERR_CORRUPT);
  EXPECT_EQ(status(test::ply_header("ascii", {"l4d_weights 2"}, 1, {"alpha_t"}) + "1\n"),
            L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(status(test::ply_header("ascii", {"l4d_weights 1"}, 1, {"x"}) + "1\n"),
            L4D_ERR_CORRUPT);
  for (const char* bad : {"-1", "nan", "inf"}) {
    EXPECT_EQ(status(test::ply_header("ascii", {"l4d_weights 1"}, 1, {"alpha_t"}) + bad + "\n"),
              L4D_ERR_CORRUPT);
  }
  EXPECT_EQ(status(test::ply_header("ascii", {"l4d_weights 1"}, 1, {"alpha_t"}) + "0\n"), L4D_OK);
}

TEST_F(WeightsTest, AreNoScene) {
  const std::string file =
      write("w.ply", test::ply_header("ascii", {"l4d_weights 1"}, 1, {"alpha_t"}) + "1\n");
  std::string message;
  EXPECT_EQ(test::status_of([&] { read_scene_ply(file); }, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("weights"), std::string::npos);
}

TEST_F(WeightsTest, OfBasketball) {
  const std::string file = test::data_file("basketball/basketball-weights.ply");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const Weights weights = read_weights_ply(file);
  EXPECT_EQ(weights.count, 213874U);
  for (const auto* column : {&weights.alpha_t, &weights.sh, &weights.scale, &weights.rotor_spatial,
                             &weights.rotor_temporal}) {
    EXPECT_EQ(column->size(), weights.count);
  }
}

}  // namespace
}  // namespace l4d::io
