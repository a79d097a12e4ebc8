// SPDX-License-Identifier: Apache-2.0
#include "io/ply/weights.h"

#include "io/ply/scene_ply.h"
#include "tests/common/files.h"
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

TEST_F(WeightsTest, WrittenAndRead) {
  Weights weights;
  weights.count = 2;
  weights.alpha_t = {0, 1};
  weights.sh = {2, 3};
  weights.scale = {4, 5};
  weights.rotor_spatial = {6, 7};
  weights.rotor_temporal = {8, 1e-30F};
  const std::string file = path("w.ply");
  write_weights_ply(file, weights);
  Weights read = read_weights_ply(file);
  EXPECT_FALSE(read.gauss_newton);
  EXPECT_TRUE(read.position.empty() && read.opacity.empty() && read.mean_t.empty());

  weights.position = {9, 10};
  weights.opacity = {11, 12};
  weights.mean_t = {13, 14};
  weights.gauss_newton = true;
  write_weights_ply(file, weights);
  read = read_weights_ply(file);
  EXPECT_EQ(read.count, 2U);
  EXPECT_TRUE(read.gauss_newton);
  EXPECT_FALSE(read.sh_is_clamped);
  for (const auto column :
       {&Weights::alpha_t, &Weights::sh, &Weights::scale, &Weights::rotor_spatial,
        &Weights::rotor_temporal, &Weights::position, &Weights::opacity, &Weights::mean_t}) {
    EXPECT_EQ(read.*column, weights.*column);
  }
  weights.mean_t.pop_back();
  EXPECT_EQ(test::status_of([&] { write_weights_ply(file, weights); }), L4D_ERR_INVALID_ARGUMENT);
  weights.mean_t.clear();
  weights.scale.clear();
  EXPECT_EQ(test::status_of([&] { write_weights_ply(file, weights); }), L4D_ERR_INVALID_ARGUMENT);
}

TEST_F(WeightsTest, Metric) {
  const auto of = [&](const std::vector<std::string>& comments) {
    return test::ply_header("ascii", comments, 1, {"alpha_t"}) + "1\n";
  };
  const auto gauss_newton = [&](const std::string& bytes) {
    return read_weights_ply(write("w.ply", bytes)).gauss_newton;
  };
  EXPECT_FALSE(gauss_newton(of({"l4d_weights 1"})));
  EXPECT_FALSE(gauss_newton(of({"l4d_weights 1", "metric sum"})));
  EXPECT_TRUE(gauss_newton(of({"l4d_weights 1", "metric gauss-newton"})));
  EXPECT_EQ(status(of({"l4d_weights 1", "metric other"})), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(status(of({"l4d_weights 1", "metric"})), L4D_ERR_FEATURE_UNSUPPORTED);
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
  const std::string file = l4d::test::data_file("basketball/basketball-weights.ply");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const Weights weights = read_weights_ply(file);
  EXPECT_EQ(weights.count, 213874U);
  EXPECT_FALSE(weights.gauss_newton);
  for (const auto* column : {&weights.alpha_t, &weights.sh, &weights.scale, &weights.rotor_spatial,
                             &weights.rotor_temporal}) {
    EXPECT_EQ(column->size(), weights.count);
  }
}

}  // namespace
}  // namespace l4d::io
