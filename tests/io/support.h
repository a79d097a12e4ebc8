// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"
#include "tests/math/reference.h"

namespace l4d::io::test {

// A directory of its own for each test, removed afterwards.
class IoTest : public ::testing::Test {
 protected:
  IoTest() {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    directory_ = std::filesystem::path(::testing::TempDir()) /
                 (std::string("l4d_") + info->test_suite_name() + "_" + info->name());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directories(directory_);
  }
  ~IoTest() override { std::filesystem::remove_all(directory_); }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  std::string write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
    return path(name);
  }
  size_t files_in_directory() const {
    return static_cast<size_t>(std::distance(std::filesystem::directory_iterator(directory_),
                                             std::filesystem::directory_iterator()));
  }

 private:
  std::filesystem::path directory_;
};

inline std::string read_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

inline InputFile in_memory(const std::string& bytes) {
  return {"memory.ply", std::vector<uint8_t>(bytes.begin(), bytes.end())};
}

template <typename T>
void append(std::string& bytes, T value, bool big_endian = false) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (big_endian) {
    for (size_t i = sizeof(T); i-- > 0;) bytes += raw[i];
  } else {
    bytes.append(raw, sizeof(T));
  }
}

// `text` with its first `from` replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

inline std::string ply_header(const std::string& format, const std::vector<std::string>& comments,
                              size_t count, const std::vector<std::string>& properties) {
  std::string text = "ply\nformat " + format + " 1.0\n";
  for (const std::string& comment : comments) text += "comment " + comment + "\n";
  text += "element vertex " + std::to_string(count) + "\n";
  for (const std::string& property : properties) text += "property float " + property + "\n";
  return text + "end_header\n";
}

// Status with which `call` fails; L4D_OK if it does not throw Error.
inline l4d_status status_of(const std::function<void()>& call, std::string* message = nullptr) {
  try {
    call();
  } catch (const Error& error) {
    if (message != nullptr) *message = error.what();
    return error.status();
  }
  return L4D_OK;
}

inline bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
}

inline void expect_same_arrays(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.sh_degree, b.sh_degree);
  EXPECT_TRUE(same_bits(a.position, b.position));
  EXPECT_TRUE(same_bits(a.mean_t, b.mean_t));
  EXPECT_TRUE(same_bits(a.log_scale, b.log_scale));
  EXPECT_TRUE(same_bits(a.rotor, b.rotor));
  EXPECT_TRUE(same_bits(a.opacity, b.opacity));
  EXPECT_TRUE(same_bits(a.sh, b.sh));
}

// Moving Gaussians, most of whose mean times lie outside the sequence.
inline Scene random_scene(uint64_t seed, size_t count, uint32_t degree) {
  reference::Random random(seed);
  Scene scene;
  scene.timeline = {1.5, 150, 30, 1, 0};
  scene.sh_degree = degree;
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  scene.resize(count);
  for (float& x : scene.position) x = static_cast<float>(random.normal());
  for (float& x : scene.sh) x = static_cast<float>(random.normal());
  for (size_t i = 0; i < count; ++i) {
    scene.mean_t[i] = static_cast<float>(random.uniform(-40, 40));
    scene.opacity[i] = static_cast<float>(3 * random.normal());
    for (size_t k = 0; k < 4; ++k) {
      scene.log_scale[4 * i + k] = static_cast<float>(random.uniform(-6, k == 3 ? 3 : -1));
    }
    reference::random_rotor(random, 0.01, &scene.rotor[8 * i]);
  }
  return scene;
}

inline bool has_motion(const Scene& scene) {
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 4; k < 8; ++k) {
      if (scene.rotor[8 * i + k] != 0) return true;
    }
  }
  return false;
}

// The slice of Gaussian i, in long double from the definitions.
struct ReferenceSlice {
  reference::Real velocity[3];
  reference::Real sigma_t;
  reference::Real covariance[6];
};
inline ReferenceSlice reference_slice(const Scene& scene, size_t i) {
  reference::Real m[4][4], rows[16];
  reference::matrix(reference::normalize(reference::load(&scene.rotor[8 * i])), m);
  for (size_t r = 0; r < 4; ++r) {
    for (size_t k = 0; k < 4; ++k) {
      rows[4 * r + k] = m[r][k] * std::exp(reference::Real(scene.log_scale[4 * i + k]));
    }
  }
  ReferenceSlice out;
  reference::Real lambda, unused[6];
  reference::schur(rows, out.velocity, &lambda, unused);
  reference::minors(rows, out.covariance);
  out.sigma_t = 1 / std::sqrt(lambda);
  return out;
}

// R diag(exp(2 log_scale)) R^T of a 3D Gaussian, xx xy xz yy yz zz.
inline void reference_covariance3(const float* wxyz, const float* log_scale,
                                  reference::Real* covariance) {
  reference::Real q[4], norm = 0;
  for (int k = 0; k < 4; ++k) norm += reference::Real(wxyz[k]) * wxyz[k];
  for (int k = 0; k < 4; ++k) q[k] = wxyz[k] / std::sqrt(norm);
  const reference::Real w = q[0], x = q[1], y = q[2], z = q[3];
  const reference::Real r[3][3] = {
      {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
      {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
      {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  int out = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      covariance[out] = 0;
      for (int k = 0; k < 3; ++k) {
        covariance[out] += r[i][k] * std::exp(2 * reference::Real(log_scale[k])) * r[j][k];
      }
      ++out;
    }
  }
}

}  // namespace l4d::io::test
