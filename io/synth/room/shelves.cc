// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

Vec3 cover(const Place& place, uint64_t key, int64_t shelf, int64_t book) {
  constexpr Vec3 kCovers[] = {{0.34, 0.05, 0.04}, {0.05, 0.10, 0.22},  {0.07, 0.16, 0.08},
                              {0.40, 0.26, 0.09}, {0.20, 0.09, 0.045}, {0.50, 0.43, 0.30},
                              {0.22, 0.05, 0.13}, {0.07, 0.17, 0.20}};
  // Sets of volumes look alike.
  const int64_t set = place.random(key, shelf, book / 4, 9) < 0.4 ? book / 4 * 4 : book;
  const size_t which = static_cast<size_t>(place.random(key, shelf, set, 1) * 8);
  return kCovers[which] * (0.75 + 0.5 * place.random(key, shelf, set, 2));
}

// A bookcase that looks along z from the origin; `wide` and `high` as asked for.
void bookcase(Place& place, const Stand& stand, double wide, double high, int shelves,
              uint64_t key) {
  constexpr double kDeep = 0.34, kBoard = 0.035;
  const auto board = [&](const Vec3& low, const Vec3& top, size_t grain) {
    put_wood(place, stand(crate(place, low, top, 0.05)), kWalnut * 1.35, grain, key, 0.3);
  };
  board({-wide / 2, 0, 0}, {-wide / 2 + kBoard, high, kDeep}, 1);
  board({wide / 2 - kBoard, 0, 0}, {wide / 2, high, kDeep}, 1);
  board({-wide / 2 - 0.03, high, 0}, {wide / 2 + 0.03, high + 0.05, kDeep + 0.03}, 0);
  board({-wide / 2, 0, 0.02}, {wide / 2, 0.09, kDeep - 0.01}, 0);
  place.put(stand(place.rectangle({-wide / 2, 0, 0.015}, kRight, kUp, wide, high, 0.08)),
            kWalnut * 0.55);
  const double gap = (high - 0.09) / shelves;
  for (int s = 0; s < shelves; ++s) {
    const double y = 0.09 + gap * s;
    if (s > 0)
      board({-wide / 2 + kBoard, y - 0.025, 0.02}, {wide / 2 - kBoard, y, kDeep - 0.015}, 0);
    double x = -wide / 2 + kBoard + 0.012;
    const double end = wide / 2 - kBoard - 0.012;
    for (int k = 0; x < end - 0.03; ++k) {
      const auto hash = [&](int64_t i) { return place.random(key + 7, s, k, i); };
      if (hash(0) < 0.045) {  // a gap, or a vase in it
        const double r = 0.045 + 0.02 * hash(1);
        if (x + 0.16 < end) {
          const Vec3 foot{x + 0.075, y, 0.2};
          place.put(stand(with_thickness(
                        turned(place, foot,
                               {{0.03, 0}, {r, 0.07}, {r * 0.9, 0.12}, {0.022, 0.17}, {0.03, 0.2}},
                               0.025),
                        0.25)),
                    [&](Dot& d) {
                      d.albedo = mix(Vec3{0.42, 0.20, 0.10}, Vec3{0.12, 0.26, 0.28}, hash(2));
                      d.gloss = 0.6;
                    });
        }
        x += 0.16;
        continue;
      }
      const double thick = std::min(0.022 + 0.035 * hash(3), end - x);
      const double tall = gap * (0.60 + 0.24 * hash(4)), front = kDeep - 0.05 - 0.05 * hash(5);
      const Vec3 color = cover(place, key + 20, s, k);
      Patch book = slab(place, {x, y, front}, kRight, kUp, thick - 0.003, tall, 0.042);
      const bool gilt = hash(6) < 0.55;
      place.put(stand(book), [&](Dot& d) {
        const double up = d.b / tall;
        const bool label = gilt && ((up > 0.66 && up < 0.80) || (up > 0.12 && up < 0.18));
        d.albedo = label ? Vec3{0.55, 0.40, 0.14} : color;
        d.gloss = 0.15;
      });
      place.put(
          stand(slab(place, {x, y + tall, front}, kRight, kFront * -1, thick - 0.003, 0.16, 0.06)),
          Vec3{0.50, 0.44, 0.33});
      x += thick;
    }
  }
  solid(place, stand, {-wide / 2, 0, 0}, {wide / 2, high, kDeep - 0.07}, kWalnut);
  for (const double side : {-1.0, 1.0}) {
    solid(place, stand, {side < 0 ? -wide / 2 : wide / 2 - kBoard, 0, 0},
          {side < 0 ? -wide / 2 + kBoard : wide / 2, high, kDeep}, kWalnut);
  }
  solid(place, stand, {-wide / 2, high, 0}, {wide / 2, high + 0.05, kDeep}, kWalnut);
}

}  // namespace

void make_shelves(Place& place) {
  bookcase(place, Stand({-2.55, 0, kRoomLow[2]}, 0), 1.66, 2.2, 6, 600);
  bookcase(place, Stand({kRoomHigh[0], 0, 2.15}, -0.25), 1.2, 2.2, 6, 640);
}

}  // namespace l4d::io::synth
