// SPDX-License-Identifier: Apache-2.0
// What the reader and the writer of .4dgs share: version 1, temporal model gaussian-birth.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace l4d::io::fdgs {

// The sixth byte is the version.
constexpr std::array<uint8_t, 8> kMagic = {0x89, '4', 'D', 'G', 'S', '1', '\r', '\n'};
constexpr size_t kVersionByte = 5;
constexpr const char* kTemporalModel = "gaussian-birth";
constexpr const char* kScheme = "uniform-v1";
// Of the header's attributes: ours, and one of the format's registry.
constexpr const char* kFrameRate = "frame_rate";
constexpr const char* kColorSpace = "color_space";
constexpr const char* kLinearColors = "linear-rec709-display";
constexpr const char* kDisplayColors = "srgb-rec709-display";

enum Opcode : uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kQuantization = 0x03,
  kWindowTable = 0x04,
  kChunk = 0x05,
  kShBand = 0x07,
  kChunkIndex = 0x08,
  kAudio = 0x09,
  kCamera = 0x0a,
  kMetadata = 0x0b,
  kStatistics = 0x0c,
  kSummaryOffset = 0x0f,
  kDeltaChunk = 0x10,
  kAudioSource = 0x11,
  kAudioData = 0x12,
  kCoordinateFrame = 0x20,
  kObjectTrack = 0x25
};

enum AttributeId : uint8_t {
  kPosition,
  kScale,
  kRotationIndex,
  kRotation,
  kColor,
  kOpacity,
  kMotion,
  kMeanTime,
  kSigma,
  kFlags,
  kWindowIndex,
  kRequiredAttributes,  // how many every chunk has
  kObjectId = 14
};
constexpr std::array<uint8_t, kRequiredAttributes> kChannels = {3, 3, 1, 3, 3, 1, 3, 1, 1, 1, 1};
constexpr int32_t kNeverFades = 1;  // of kFlags

// Values between two bins that follow each other.
struct Grids {
  std::array<double, 3> origin{};
  double position = 0, scale_log = 0, rotation = 0, color = 0, opacity = 0, motion = 0, time = 0,
         sigma_log = 0;
};

// A byte of spherical harmonics.
constexpr double kLeastHarmonic = -4, kHarmonicStep = 8.0 / 255;

// Steps of a Gaussian's own, by how long it is there. sigma: seconds, infinity if it never fades.
// window: seconds.
inline double motion_step(const Grids& grids, double cutoff, double sigma, double window) {
  double half = std::isinf(sigma) ? window : std::sqrt(-2 * std::log(cutoff)) * sigma;
  half = half > 0.02 ? std::min(half, 2.0) : 0.02;  // also where it is no number
  const double lifetime = std::clamp(std::ceil(std::log2(half / 0.5)), -4.0, 2.0);
  return std::ldexp(grids.motion, -static_cast<int>(lifetime));
}
inline double time_step(const Grids& grids, double sigma) {
  const double target = std::isinf(sigma) ? grids.time : std::min(grids.time, 0.05 * sigma);
  const double finer = std::floor(std::log2(target / grids.time));
  return std::ldexp(grids.time, finer > -10 ? static_cast<int>(std::min(finer, 0.0)) : -10);
}

}  // namespace l4d::io::fdgs
