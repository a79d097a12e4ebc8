// SPDX-License-Identifier: Apache-2.0
#include "tests/numerics/hard_scenes.h"

#include <algorithm>
#include <cmath>

#include "io/scene/rotor_math.h"
#include "tests/common/random.h"

namespace l4d::numerics {
namespace {

using test::Random;
using test::TestScene;

constexpr uint64_t kCount = 1500;

io::Matrix3 random_rotation(Random& random) {
  double q[4], norm = 0;
  for (double& v : q) {
    v = random.normal();
    norm += v * v;
  }
  for (double& v : q) v /= std::sqrt(std::max(norm, 1e-12));
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

// A moving 3D Gaussian in place of number i.
void put(TestScene& s, size_t i, Random& random, const io::Vec3& size, const io::Vec3& velocity,
         double mean, double sigma) {
  const io::Shape4 shape = io::shape_of_moving(random_rotation(random), size, velocity, sigma);
  for (size_t k = 0; k < 8; ++k) s.rotor[8 * i + k] = static_cast<float>(shape.rotor[k]);
  for (size_t k = 0; k < 4; ++k) {
    s.log_scale[4 * i + k] =
        std::clamp(static_cast<float>(std::log(shape.scale[k])), -15.9f, 15.9f);
  }
  s.mean_t[i] = static_cast<float>(mean);
}

// 10 s in a room of about 10 units, everything still and permanent.
TestScene room(uint64_t seed) {
  test::SceneOptions o;
  o.count = kCount;
  o.sh_degree = 0;
  o.num_frames = 300;
  o.permanent = 1;
  o.seed = seed;
  return test::make_scene(o);
}

io::Vec3 sizes(Random& random, double low, double high) {
  io::Vec3 out;
  for (double& v : out) v = std::exp(random.uniform(std::log(low), std::log(high)));
  return out;
}

TestScene cars(double speed) {
  TestScene s = room(11);
  Random random(12);
  for (size_t i = 0; i < kCount / 5; ++i) {
    const double angle = random.uniform(-0.1, 0.1);
    put(s, i, random, sizes(random, 0.02, 0.3),
        {speed * std::cos(angle), speed * std::sin(angle), 0}, random.uniform(0, 10),
        random.uniform(0.05, 1.5));
  }
  return s;
}
TestScene slow_cars() { return cars(10); }
TestScene fast_cars() { return cars(30); }

TestScene flashes() {
  TestScene s = room(21);
  Random random(22);
  for (size_t i = 0; i < kCount / 10; ++i) {
    put(s, i, random, sizes(random, 0.5, 3), {0, 0, 0}, random.uniform(0, 10),
        random.uniform(0.01, 0.1));
  }
  return s;
}

TestScene floaters() { return room_with_floaters(1e5, 5); }

TestScene needles() {
  TestScene s = room(41);
  Random random(42);
  for (size_t i = 0; i < kCount / 4; ++i) {
    const double length = random.uniform(0.2, 2);
    put(s, i, random, {length, length * 1e-3, length * 1e-3},
        {random.normal(), random.normal(), random.normal()}, random.uniform(0, 10),
        random.uniform(0.1, 2));
  }
  return s;
}

// Sizes, lifetimes and speeds over many orders of magnitude.
TestScene ratios() {
  TestScene s = room(51);
  Random random(52);
  for (size_t i = 0; i < kCount / 2; ++i) {
    const double speed = std::exp(random.uniform(-7, 3));
    put(s, i, random, sizes(random, 1e-3, 5),
        {speed * random.normal(), speed * random.normal(), speed * random.normal()},
        random.uniform(-5, 15), std::exp(random.uniform(-4, 4)));
  }
  return s;
}

// Rotors whose two halves point in opposite directions, or nearly.
TestScene opposite_halves() {
  TestScene s = room(61);
  for (size_t i = 0; i < s.count(); i += 2) {
    float* r = s.rotor.data() + 8 * i;
    const float old[8] = {r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7]};
    const float other[8] = {old[7], -old[6], old[5], -old[4], -old[3], old[2], -old[1], old[0]};
    std::copy_n(other, 8, r);
  }
  return s;
}

TestScene everything_moves() {
  test::SceneOptions o;
  o.count = kCount;
  o.sh_degree = 0;
  o.num_frames = 300;
  o.permanent = 0.2;
  o.speed = 0.3;
  o.seed = 71;
  return test::make_scene(o);
}

}  // namespace

TestScene room_with_floaters(double distance, size_t floaters) {
  TestScene s = room(31);
  Random random(32);
  for (size_t i = s.count() - floaters; i < s.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      s.position[3 * i + k] = static_cast<float>(distance * random.uniform(-1, 1));
    }
  }
  return s;
}

const std::vector<HardScene>& hard_scenes() {
  static const std::vector<HardScene> kScenes = {
      {"cars-10", "a car at 10 units/s through a still room", slow_cars},
      {"cars-30", "a car at 30 units/s", fast_cars},
      {"flashes", "large flashes of 10 to 100 ms that stand still", flashes},
      {"floaters", "5 Gaussians 1e5 units away", floaters},
      {"needles", "moving needles, 1000 : 1", needles},
      {"ratios", "sizes, lifetimes and speeds over four orders of magnitude", ratios},
      {"opposite", "rotors with B = -A", opposite_halves},
      {"moving", "fast rotors of any lifetime", everything_moves}};
  return kScenes;
}

}  // namespace l4d::numerics
