// SPDX-License-Identifier: Apache-2.0
// Sorting splats by depth, and their lists per tile.
#include "render/cpu/fast/bins.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <set>
#include <vector>

#include "tests/common/random.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::Random;

// ---- sorting -----------------------------------------------------------------------------------

struct Sorted {
  std::vector<FastSplat> splats;
  std::vector<uint32_t> expected;  // rows
};

// Splats in parts that are not full, with the rows numbered as they come.
Sorted sort(const std::vector<float>& depths, size_t per_part, int threads) {
  std::vector<size_t> counts;
  std::vector<FastSplat> splats;
  for (size_t i = 0; i < depths.size(); i += per_part) {
    counts.push_back(std::min(per_part, depths.size() - i));
    splats.resize(DepthSort::kPart * counts.size());
    for (size_t k = 0; k < counts.back(); ++k) {
      FastSplat& s = splats[DepthSort::kPart * (counts.size() - 1) + k];
      s.depth = depths[i + k];
      s.row = static_cast<uint32_t>(i + k);
    }
  }
  Sorted out;
  EXPECT_TRUE(DepthSort().sort(splats.data(), counts, threads, unlimited(), &out.splats).ok());
  for (size_t i = 0; i < depths.size(); ++i) out.expected.push_back(static_cast<uint32_t>(i));
  std::stable_sort(out.expected.begin(), out.expected.end(),
                   [&](uint32_t a, uint32_t b) { return depths[a] < depths[b]; });
  return out;
}

void expect_sorted(const std::vector<float>& depths, size_t per_part) {
  for (const int threads : {1, 2, 7}) {
    const Sorted s = sort(depths, per_part, threads);
    ASSERT_EQ(s.splats.size(), depths.size());
    for (size_t i = 0; i < depths.size(); ++i) {
      ASSERT_EQ(s.splats[i].row, s.expected[i]) << i << " of " << depths.size();
      ASSERT_EQ(s.splats[i].depth, depths[s.expected[i]]);
    }
  }
}

TEST(DepthSort, StableAtEverySize) {
  Random random(1);
  for (const size_t n : {0u, 1u, 2u, 4095u, 4096u, 16385u, 100000u}) {
    std::vector<float> depths(n);
    for (float& d : depths) d = static_cast<float>(std::exp(random.uniform(-4, 8)));
    expect_sorted(depths, DepthSort::kPart);
    expect_sorted(depths, 1000);
    // Few different depths.
    for (float& d : depths) d = 1.0f + 0.25f * static_cast<float>(random.below(5));
    expect_sorted(depths, 3000);
    // One bit apart, from the smallest depth to the largest.
    for (float& d : depths) d = random.below(2) != 0 ? 0x1p-149f : 3e38f;
    for (size_t i = 0; i < n; i += 3) {
      depths[i] = std::nextafter(2.0f, random.below(2) != 0 ? 3.0f : 1.0f);
    }
    expect_sorted(depths, 4096);
  }
}

// Memory of a larger call does not show in a smaller one.
TEST(DepthSort, CallsShareNothing) {
  Random random(2);
  DepthSort sort;
  std::vector<FastSplat> splats(DepthSort::kPart), sorted;
  for (const size_t n : {4000u, 10u, 0u, 300u}) {
    for (size_t i = 0; i < n; ++i) {
      splats[i].depth = random.uniformf(1, 2);
      splats[i].row = static_cast<uint32_t>(i);
    }
    ASSERT_TRUE(sort.sort(splats.data(), {n}, 2, unlimited(), &sorted).ok());
    ASSERT_EQ(sorted.size(), n);
    std::set<uint32_t> rows;
    for (size_t i = 0; i < n; ++i) {
      rows.insert(sorted[i].row);
      EXPECT_TRUE(i == 0 || sorted[i - 1].depth <= sorted[i].depth);
    }
    EXPECT_EQ(rows.size(), n);
  }
}

// ---- tiles -------------------------------------------------------------------------------------

// Of covariance xx xy yy.
FastSplat make_splat(double x, double y, double xx, double xy, double yy, double opacity) {
  FastSplat s{};
  const double det = xx * yy - xy * xy, scale = -0.5 * 1.4426950408889634 / det;
  s.mean[0] = static_cast<float>(x);
  s.mean[1] = static_cast<float>(y);
  s.conic[0] = static_cast<float>(scale * yy);
  s.conic[1] = static_cast<float>(-2 * scale * xy);
  s.conic[2] = static_cast<float>(scale * xx);
  s.opacity = static_cast<float>(opacity);
  s.log2_opacity = static_cast<float>(std::log2(opacity));
  s.log2_least = kLog2MinAlpha;
  const double reach = 2 * std::log(255 * opacity);
  s.extent[0] = static_cast<float>(std::sqrt(reach * xx));
  s.extent[1] = static_cast<float>(std::sqrt(reach * yy));
  s.depth = 1;
  return s;
}

// Blobs, needles and giants, inside and around an image.
std::vector<FastSplat> random_splats(size_t count, int width, int height) {
  Random random(3);
  std::vector<FastSplat> splats;
  while (splats.size() < count) {
    const double angle = random.uniform(0, 3.14159265), c = std::cos(angle), s = std::sin(angle);
    const double long_side = std::exp(random.uniform(-1, random.below(10) == 0 ? 6 : 3));
    const double short_side = random.below(2) != 0 ? 0 : long_side * random.uniform();
    const double a = long_side * long_side, b = short_side * short_side;
    FastSplat splat =
        make_splat(random.uniform(-0.3, 1.3) * width, random.uniform(-0.3, 1.3) * height,
                   a * c * c + b * s * s + 0.3, (a - b) * c * s, a * s * s + b * c * c + 0.3,
                   random.uniform(1.01 / 255, 1));
    splat.row = static_cast<uint32_t>(splats.size());
    splats.push_back(splat);
  }
  return splats;
}

double log2_alpha(const FastSplat& s, double x, double y) {
  const double dx = x - static_cast<double>(s.mean[0]), dy = y - static_cast<double>(s.mean[1]);
  return static_cast<double>(s.log2_opacity) + static_cast<double>(s.conic[0]) * dx * dx +
         static_cast<double>(s.conic[1]) * dx * dy + static_cast<double>(s.conic[2]) * dy * dy;
}

// Largest log2(alpha) in the rectangle of a tile's pixel centres: at the mean, or on the border.
double largest_in_tile(const FastSplat& s, double x0, double y0, double x1, double y1) {
  const double mx = static_cast<double>(s.mean[0]), my = static_cast<double>(s.mean[1]);
  if (mx >= x0 && mx <= x1 && my >= y0 && my <= y1) return static_cast<double>(s.log2_opacity);
  const double a = static_cast<double>(s.conic[0]), b = static_cast<double>(s.conic[1]),
               c = static_cast<double>(s.conic[2]);
  double most = -INFINITY;
  for (const double y : {y0, y1}) {  // along x the parabola's top is at dx = -b dy / 2a
    const double x = std::clamp(mx - b * (y - my) / (2 * a), x0, x1);
    most = std::max(most, log2_alpha(s, x, y));
  }
  for (const double x : {x0, x1}) {
    const double y = std::clamp(my - b * (x - mx) / (2 * c), y0, y1);
    most = std::max(most, log2_alpha(s, x, y));
  }
  return most;
}

void build_whole(TileBins* bins, const std::vector<FastSplat>& splats, int width, int height,
                 bool with_places, int threads) {
  ASSERT_TRUE(bins->start(splats, width, height, threads, unlimited()).ok());
  ASSERT_TRUE(bins->build(splats, bins->whole(), with_places, threads, unlimited()).ok());
}

void check_tiles(int width, int height, size_t count) {
  const std::vector<FastSplat> splats = random_splats(count, width, height);
  TileBins bins;
  build_whole(&bins, splats, width, height, true, 2);
  ASSERT_EQ(bins.columns(), (width + kTile - 1) / kTile);
  ASSERT_EQ(bins.rows(), (height + kTile - 1) / kTile);
  const double level = std::log2(1.0 / 255);
  size_t reached = 0, touched = 0, listed = 0;
  for (int row = 0; row < bins.rows(); ++row) {
    for (int column = 0; column < bins.columns(); ++column) {
      const size_t tile = static_cast<size_t>(row * bins.columns() + column);
      std::vector<bool> in_list(splats.size(), false);
      for (size_t n = 0; n < bins.count(tile); ++n) {
        const uint32_t i = bins.list(tile)[n];
        EXPECT_TRUE(n == 0 || bins.list(tile)[n - 1] < i) << "front to back, each once";
        in_list[i] = true;
      }
      listed += bins.count(tile);
      const int x0 = column * kTile, y0 = row * kTile;
      const int x1 = std::min(x0 + kTile, width), y1 = std::min(y0 + kTile, height);
      for (size_t i = 0; i < splats.size(); ++i) {
        const FastSplat& s = splats[i];
        // Lists end with whole tiles, the image may end within.
        const double right = x0 + kTile - 0.5, bottom = y0 + kTile - 0.5;
        touched += largest_in_tile(s, x0 + 0.5, y0 + 0.5, right, bottom) >= level;
        if (largest_in_tile(s, x0 + 0.5, y0 + 0.5, x1 - 0.5, y1 - 0.5) < level) continue;
        bool pixel = false;
        for (int y = y0; y < y1 && !pixel; ++y) {
          for (int x = x0; x < x1 && !pixel; ++x) pixel = log2_alpha(s, x + 0.5, y + 0.5) >= level;
        }
        reached += pixel;
        EXPECT_TRUE(!pixel || in_list[i]) << "tile " << column << ", " << row << ", splat " << i;
      }
    }
  }
  EXPECT_EQ(bins.instances(), listed);
  // Places lead from each splat to its entries.
  size_t entries = 0;
  for (size_t i = 0; i < splats.size(); ++i) {
    for (size_t e = bins.emitted(i); e < bins.emitted(i + 1); ++e, ++entries) {
      ASSERT_LT(bins.place(e), listed);
      EXPECT_EQ(bins.list(0)[bins.place(e)], i);
    }
  }
  EXPECT_EQ(entries, listed);
  std::cout << width << "x" << height << ": " << listed << " pairs of splat and tile, "
            << "ellipses touch " << touched << ", reach a pixel centre in " << reached << "\n";
  EXPECT_GE(listed, touched - touched / 1000);
  // Where an ellipse that leaves the image has one row or column of tiles left, its box decides.
  EXPECT_LE(static_cast<double>(listed), 1.05 * static_cast<double>(touched) + 8);
}

TEST(TileBins, ExactlyTheTilesThatSplatsReach) {
  check_tiles(333, 217, 1500);
  check_tiles(640, 48, 500);
  check_tiles(16, 16, 300);
  check_tiles(17, 5, 300);
  check_tiles(1, 1, 300);
}

TEST(TileBins, NothingAndThreads) {
  TileBins empty;
  build_whole(&empty, {}, 40, 20, true, 2);
  EXPECT_EQ(empty.instances(), 0u);
  EXPECT_EQ(empty.count(0) + empty.count(5), 0u);
  const std::vector<FastSplat> splats = random_splats(40000, 300, 200);
  TileBins one, many;
  build_whole(&one, splats, 300, 200, false, 1);
  build_whole(&many, splats, 300, 200, true, 7);
  build_whole(&many, splats, 300, 200, false, 7);
  ASSERT_EQ(one.instances(), many.instances());
  EXPECT_TRUE(std::equal(one.list(0), one.list(0) + one.instances(), many.list(0)));
  const size_t tiles = static_cast<size_t>(one.columns() * one.rows());
  for (size_t t = 0; t < tiles; ++t) ASSERT_EQ(one.first(t), many.first(t));
}

}  // namespace
}  // namespace l4d::render
