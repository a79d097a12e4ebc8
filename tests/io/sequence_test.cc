// SPDX-License-Identifier: Apache-2.0
#include "io/sequence/sequence.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "io/ply/scene_ply.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using reference::Random;
using reference::Real;

constexpr double kFps = 10;

class SequenceTest : public test::IoTest {
 protected:
  // Gaussians whose colour tells them apart.
  static Splats splats_of(size_t count) {
    Splats splats;
    Random random(3);
    splats.position.resize(3 * count);
    splats.opacity.assign(count, 0.8F);
    for (size_t i = 0; i < count; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        splats.position[3 * i + k] = static_cast<float>(random.uniform(-5, 5));
        splats.sh.push_back(static_cast<float>(random.uniform(-1, 1)));
      }
      for (const float c : {0.04F, 0.0F, 0.0F, 0.01F, 0.0F, 0.0025F})
        splats.covariance.push_back(c);
    }
    return splats;
  }
  std::string write_frame(size_t k, const Splats& splats) {
    const std::string file = path("f" + std::to_string(k) + ".ply");
    write_3dgs_ply(file, splats);
    paths_.push_back(file);
    return file;
  }
  Scene read(SequenceMatch match = SequenceMatch::kAuto) {
    SequenceOptions options;
    options.paths = paths_;
    options.fps = kFps;
    options.match = match;
    return read_sequence(options, &report_);
  }

  // What the scene shows at the time of a frame, by the definitions: place and opacity of Gaussian
  // i.
  static bool show(const Scene& scene, size_t i, uint32_t frame, Real* place, Real* opacity) {
    const Real t = frame / Real(kFps);
    const test::ReferenceSlice s = test::reference_slice(scene, i);
    const Real mean = scene.mean_time(i);
    const Real end = scene.timeline.num_frames / Real(kFps);
    const Real at = std::min(std::max(mean, Real(0)), end);
    for (size_t k = 0; k < 3; ++k) place[k] = scene.position[3 * i + k] + s.velocity[k] * (t - at);
    *opacity = scene.opacity[i];
    if (!scene.window.empty() && scene.window[2 * i + 1] != 0) {
      return frame >= scene.window[2 * i] && frame < scene.window[2 * i + 1];
    }
    *opacity *= std::exp(-(t - mean) * (t - mean) / (2 * s.sigma_t * s.sigma_t));
    return *opacity >= 1 / Real(255);
  }
  // Every Gaussian of a frame has one of the scene at its place, and no other is there. Colours
  // identify them.
  static void expect_frame(const Scene& scene, uint32_t frame, const Splats& splats,
                           double position_error, double opacity_error) {
    std::vector<size_t> shown;
    for (size_t i = 0; i < scene.count(); ++i) {
      Real place[3], opacity = 0;
      if (show(scene, i, frame, place, &opacity)) shown.push_back(i);
    }
    size_t seen = 0;
    for (size_t j = 0; j < splats.count(); ++j) {
      if (splats.opacity[j] < 1.0F / 255) continue;
      ++seen;
      size_t found = 0;
      for (const size_t i : shown) {
        if (std::abs(scene.sh[3 * i] - splats.sh[3 * j]) > 1e-6F) continue;
        ++found;
        Real place[3], opacity = 0;
        show(scene, i, frame, place, &opacity);
        for (size_t k = 0; k < 3; ++k) {
          EXPECT_NEAR(static_cast<double>(place[k]), splats.position[3 * j + k], position_error)
              << "frame " << frame << " row " << j;
        }
        EXPECT_NEAR(static_cast<double>(opacity), splats.opacity[j], opacity_error)
            << "frame " << frame << " row " << j;
      }
      EXPECT_EQ(found, 1U) << "frame " << frame << " row " << j;
    }
    EXPECT_LE(shown.size(), seen + 2) << "frame " << frame;
  }

  std::vector<std::string> paths_;
  SequenceReport report_;
};

TEST_F(SequenceTest, LinesBecomeOneGaussianEach) {
  std::vector<Splats> frames;
  for (size_t k = 0; k < 12; ++k) {
    Splats splats = splats_of(40);
    for (size_t i = 0; i < 20; ++i) {
      splats.position[3 * i] += 0.3F * static_cast<float>(k);
      splats.position[3 * i + 1] -= 0.05F * static_cast<float>(k);
    }
    write_frame(k, splats);
    frames.push_back(std::move(splats));
  }
  const Scene scene = read();
  EXPECT_EQ(scene.count(), 40U);
  EXPECT_EQ(report_.windows, 0U);
  EXPECT_TRUE(report_.in_order);
  EXPECT_EQ(report_.rows, 480U);
  EXPECT_EQ(report_.matched, 440U);
  EXPECT_EQ(scene.timeline.num_frames, 12U);
  for (uint32_t k = 0; k < 12; ++k) expect_frame(scene, k, frames[k], 1e-4, 1e-3);
}

TEST_F(SequenceTest, CurvesBecomePiecesWithinTheTolerance) {
  std::vector<Splats> frames;
  for (size_t k = 0; k < 30; ++k) {
    Splats splats = splats_of(30);
    for (size_t i = 0; i < 30; ++i) {
      splats.position[3 * i] += std::sin(0.1F * static_cast<float>(k));
      splats.position[3 * i + 2] += std::cos(0.1F * static_cast<float>(k));
    }
    write_frame(k, splats);
    frames.push_back(std::move(splats));
  }
  const Scene scene = read();
  EXPECT_GT(report_.windows, 60U);
  EXPECT_LT(report_.windows, 250U);  // of 900 rows
  // 0.1 of the middle standard deviation, 0.1.
  for (uint32_t k = 0; k < 30; ++k) expect_frame(scene, k, frames[k], 0.0101, 0.0101);
}

TEST_F(SequenceTest, GaussianFadesComeBackAsThose) {
  std::vector<Splats> frames;
  constexpr double kMean = 11.3, kSigma = 2.1;
  for (size_t k = 0; k < 30; ++k) {
    Splats splats = splats_of(10);
    const double dt = static_cast<double>(k) - kMean;
    for (size_t i = 0; i < 10; ++i) {
      splats.opacity[i] = static_cast<float>(0.7 * std::exp(-dt * dt / (2 * kSigma * kSigma)));
      splats.position[3 * i] += 0.1F * static_cast<float>(k);
    }
    write_frame(k, splats);
    frames.push_back(std::move(splats));
  }
  const Scene scene = read();
  ASSERT_EQ(scene.count(), 10U);
  EXPECT_EQ(report_.windows, 0U);
  EXPECT_GT(report_.unseen, 0U);
  for (size_t i = 0; i < 10; ++i) {
    EXPECT_NEAR(scene.mean_time(i), kMean / kFps, 1e-4);
    EXPECT_NEAR(scene.opacity[i], 0.7, 1e-3);
    EXPECT_NEAR(static_cast<double>(test::reference_slice(scene, i).sigma_t), kSigma / kFps, 1e-4);
  }
  for (uint32_t k = 0; k < 30; ++k) expect_frame(scene, k, frames[k], 1e-4, 2e-3);
}

// Rows in any order, some of which come and go at once.
TEST_F(SequenceTest, ContentTellsGaussiansApart) {
  std::vector<Splats> frames;
  for (size_t k = 0; k < 10; ++k) {
    const Splats all = splats_of(60);
    std::vector<size_t> order(60);
    std::iota(order.begin(), order.end(), size_t{0});
    std::rotate(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(7 * k % 60),
                order.end());
    Splats splats;
    for (const size_t i : order) {
      if (i % 3 == 0 && (k < 3 || k >= 7)) continue;
      for (size_t c = 0; c < 3; ++c) {
        splats.position.push_back(all.position[3 * i + c] +
                                  (c == 0 ? 0.05F * static_cast<float>(k) : 0));
        splats.sh.push_back(all.sh[3 * i + c]);
      }
      for (size_t c = 0; c < 6; ++c) splats.covariance.push_back(all.covariance[6 * i + c]);
      splats.opacity.push_back(all.opacity[i]);
    }
    write_frame(k, splats);
    frames.push_back(std::move(splats));
  }
  const Scene scene = read();
  EXPECT_EQ(scene.count(), 60U);
  EXPECT_EQ(report_.windows, 20U);
  EXPECT_FALSE(report_.in_order);
  for (uint32_t k = 0; k < 10; ++k) expect_frame(scene, k, frames[k], 1e-4, 1e-3);
}

// Content that differs a little from frame to frame: mutually nearest rows go on.
TEST_F(SequenceTest, NearestRowsGoOn) {
  Random random(9);
  std::vector<Splats> frames;
  for (size_t k = 0; k < 8; ++k) {
    Splats splats = splats_of(50);
    for (float& x : splats.position) x += static_cast<float>(random.uniform(-1e-3, 1e-3));
    for (float& x : splats.opacity) x += static_cast<float>(random.uniform(-1e-3, 1e-3));
    if (k % 2 == 1) {  // no order
      for (size_t c = 0; c < 3; ++c) std::swap(splats.position[c], splats.position[147 + c]);
      for (size_t c = 0; c < 3; ++c) std::swap(splats.sh[c], splats.sh[147 + c]);
    }
    for (float& c : splats.covariance) c *= 1 + static_cast<float>(random.uniform(-1e-3, 1e-3));
    write_frame(k, splats);
  }
  const Scene scene = read(SequenceMatch::kContent);
  EXPECT_EQ(scene.count(), 50U);
  EXPECT_EQ(report_.matched, 350U);
}

TEST_F(SequenceTest, WithoutAMatchEachRowLivesForItsFrame) {
  for (size_t k = 0; k < 3; ++k) write_frame(k, splats_of(5));
  const Scene scene = read(SequenceMatch::kNone);
  ASSERT_EQ(scene.count(), 15U);
  for (size_t i = 0; i < 15; ++i) EXPECT_EQ(scene.window[2 * i + 1] - scene.window[2 * i], 1U);
}

TEST_F(SequenceTest, RefusesWhatIsNoFrame) {
  std::string message;
  write_frame(0, splats_of(3));
  Splats degree1 = splats_of(3);
  degree1.sh_degree = 1;
  degree1.sh.assign(36, 0);
  write_frame(1, degree1);
  EXPECT_EQ(test::status_of([&] { read(); }, &message), L4D_ERR_INVALID_SCENE);
  EXPECT_NE(message.find("f1.ply: spherical harmonics of degree 1"), std::string::npos) << message;
  std::string placed = test::read_bytes(path("f0.ply"));
  placed.insert(placed.find("element"),
                "comment l4d_scale 2\ncomment l4d_coordinates right_up_back\n");
  write("f1.ply", placed);
  EXPECT_EQ(test::status_of([&] { read(); }, &message), L4D_ERR_INVALID_SCENE);
  EXPECT_NE(
      message.find("f1.ply: it differs from the frames before in scale and coordinate system: "
                   "it states \"l4d_scale 2, l4d_coordinates right_up_back\", these state "
                   "nothing"),
      std::string::npos)
      << message;
  paths_ = {path("f0.ply"), path("absent.ply")};
  EXPECT_EQ(test::status_of([&] { read(); }), L4D_ERR_IO);
  const Scene scene = read_scene_ply(path("f0.ply"));
  write_l4d_ply(path("time.ply"), scene);
  paths_ = {path("time.ply")};
  EXPECT_EQ(test::status_of([&] { read(); }, &message), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("l4dcodec slice"), std::string::npos) << message;
  paths_.clear();
  EXPECT_EQ(test::status_of([&] { read(); }), L4D_ERR_INVALID_ARGUMENT);
}

// Notes of frames come once; what is no Gaussian does not count as too faint.
TEST_F(SequenceTest, TellsWhatReadersOfFramesNote) {
  for (size_t k = 0; k < 3; ++k) write_frame(k, splats_of(4));
  for (const size_t k : {size_t{1}, size_t{2}}) {
    std::string text =
        test::ply_header("ascii", {}, k,
                         {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1", "rot_2",
                          "rot_3", "scale_0", "scale_1", "scale_2", "opacity", "segment"});
    for (size_t i = 0; i < k; ++i) text += "0 0 1 0 0 0 0 0 0 0 -3 -3 -3 0.5 7\n";
    write("f" + std::to_string(k) + ".ply", text);
  }
  const std::vector<std::string> notes = read().notes;
  ASSERT_EQ(notes.size(), 2U);  // nothing of normals
  EXPECT_EQ(notes[0], "In 2 of 3 frames, first in " + paths_[1] +
                          ": 1 of 15 properties were not read: segment.");
  EXPECT_EQ(notes[1], "In 2 of 3 frames, first in " + paths_[1] +
                          ": Rotations of length 0, which are taken as none: 1.");
  std::string message;
  write("f2.ply", test::ply_header("ascii", {}, 1,
                                   {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1",
                                    "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"}) +
                      "nan 0 1 0 0 0 1 0 0 0 -3 -3 -3 0.5\n");
  EXPECT_EQ(test::status_of([&] { read(); }, &message), L4D_ERR_INVALID_SCENE);
  EXPECT_NE(message.find("f2.ply: Gaussian 0 has an invalid position"), std::string::npos)
      << message;
}

TEST_F(SequenceTest, OrderOfUnequalCountsIsNoted) {
  write_frame(0, splats_of(4));
  write_frame(1, splats_of(3));
  write_frame(2, splats_of(4));
  EXPECT_EQ(read(SequenceMatch::kOrder).notes,
            std::vector<std::string>{
                "Rows with one index are taken for one Gaussian, but frames have different numbers "
                "of rows, first in " +
                paths_[1] + " (3, before it 4). Matching by content may take fewer Gaussians."});
  EXPECT_EQ(read(SequenceMatch::kContent).notes, std::vector<std::string>{});
}

// How frames are to be drawn is said of the sequence, and how it is shown where all agree.
TEST_F(SequenceTest, KeepsWhatFramesStateOfTheirRendering) {
  const auto write_stating = [&](size_t k, const std::vector<std::string>& comments) {
    const std::string text =
        test::ply_header("ascii", comments, 1,
                         {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1", "rot_2",
                          "rot_3", "scale_0", "scale_1", "scale_2", "opacity"});
    write("f" + std::to_string(k) + ".ply", text + "0 0 1 0 0 0 1 0 0 0 -3 -3 -3 0.5\n");
  };
  paths_ = {path("f0.ply"), path("f1.ply")};
  const std::string drawn = "l4d_rendering compensation=1", shown = "l4d_presentation playback=";
  write_stating(0, {drawn, shown + "loop"});
  write_stating(1, {drawn, shown + "loop"});
  EXPECT_EQ(read().rendering.compensation, 1U);
  EXPECT_EQ(read().presentation.playback, static_cast<uint32_t>(L4D_PLAYBACK_LOOP));
  write_stating(1, {drawn, shown + "once"});
  EXPECT_EQ(read().presentation.playback, static_cast<uint32_t>(L4D_PLAYBACK_UNSTATED));
  write_stating(1, {shown + "loop"});
  std::string message;
  EXPECT_EQ(test::status_of([&] { read(); }, &message), L4D_ERR_INVALID_SCENE);
  EXPECT_NE(message.find("f1.ply: its rendering"), std::string::npos) << message;
}

// Memory does not grow with the number of frames.
TEST_F(SequenceTest, HoldsAFewFrames) {
  const auto peak = [&](size_t frames) {
    paths_.clear();
    for (size_t k = 0; k < frames; ++k) write_frame(k, splats_of(500));
    const MemoryBudget budget("limit", uint64_t{1} << 40);
    uint64_t most = 0;
    SequenceOptions options;
    options.paths = paths_;
    options.holder = [&](uint64_t bytes, const std::string& what) {
      auto held = budget.take(bytes, what);
      most = std::max(most, budget.held());
      return held;
    };
    read_sequence(options);
    return most;
  };
  const uint64_t few = peak(4);
  EXPECT_GT(few, 500U * 62 * sizeof(float));
  EXPECT_EQ(peak(20), few);
}

}  // namespace
}  // namespace l4d::io
