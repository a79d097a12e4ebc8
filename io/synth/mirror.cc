// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "io/synth/light.h"
#include "io/synth/sh_basis.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io::synth {
namespace {

constexpr size_t kLooks = 96;  // directions of looking: rather level, more from above
constexpr size_t K = kShCoefficients;

struct Looks {
  Vec3 way[kLooks];
  double basis[kLooks][K];

  Looks() {
    for (size_t m = 0; m < kLooks; ++m) {
      const double k = static_cast<double>(m) + 0.5, y = -0.75 + 0.95 * k / kLooks;
      const Vec3 around = on_circle(k * 0.3819660112501051, std::sqrt(1 - y * y));
      way[m] = {around[0], y, around[2]};
      basis[m][0] = sh_constant::k0;
      sh_basis(way[m], basis[m] + 1);
    }
  }
};

// Dots that share what they mirror: by place and by normal. Chrome shares nothing.
using Cell = std::array<int64_t, 7>;
Cell cell_of(const Dot& d, double size, size_t i) {
  const auto whole = [](double x) { return static_cast<int64_t>(std::floor(x)); };
  return {whole(d.p[0] / size),
          whole(d.p[1] / size),
          whole(d.p[2] / size),
          whole(d.n[0] * 4 + 0.5),
          whole(d.n[1] * 4 + 0.5),
          whole(d.n[2] * 4 + 0.5),
          d.kind == Kind::kChrome ? static_cast<int64_t>(i) + 1 : 0};
}

// What a cell mirrors, and the least squares for it: weights, and a ridge that pulls a
// coefficient the more the finer it is.
class Mirror {
 public:
  Mirror(const Looks& looks, const Light& light, const Dot& d)
      : looks_(looks), metal_(d.kind == Kind::kChrome) {
    for (size_t m = 0; m < kLooks; ++m) {
      const double cosine = 0.0 - dot(looks.way[m], d.n);
      cosine_[m] = clamp(cosine, 0, 1);
      weight_[m] = clamp(cosine * 4, 0.02, 1) * 2 * kTurn / kLooks;
      seen_[m] = {};
      if (cosine <= 0.03) continue;
      seen_[m] = light.seen_along(d.p + d.n * 0.03, unit(looks.way[m] + d.n * (2 * cosine)));
    }
    factor();
  }

  void solve(const Dot& d, const Vec3& linear, float* sh /* [16, 3] */) const {
    double right[3][K] = {};
    const Vec3 plain = displayed(linear);
    for (size_t m = 0; m < kLooks; ++m) {
      const double rim = 1 - cosine_[m],
                   gloss = (0.03 + 0.60 * rim * rim * rim * std::sqrt(rim)) * d.gloss;
      const Vec3 shown = displayed(linear + seen_[m] * (metal_ ? 0.86 : gloss));
      for (size_t c = 0; c < 3; ++c) {
        const double value = weight_[m] * (shown[c] - 0.5);
        for (size_t k = 0; k < K; ++k) right[c][k] += value * looks_.basis[m][k];
      }
    }
    for (size_t c = 0; c < 3; ++c) {
      right[c][0] += ridge(0) * (plain[c] - 0.5) / sh_constant::k0;
      back(right[c]);
      for (size_t k = 0; k < K; ++k) sh[3 * k + c] = static_cast<float>(right[c][k]);
    }
  }

 private:
  double ridge(size_t k) const {
    const double r = k == 0 ? 0.02 : (k < 4 ? 0.25 : (k < 9 ? 0.5 : 0.8));
    return metal_ ? 0.04 * r : r;
  }

  void factor() {  // Cholesky
    for (size_t i = 0; i < K; ++i) {
      for (size_t j = 0; j <= i; ++j) {
        double sum = i == j ? ridge(i) : 0;
        for (size_t m = 0; m < kLooks; ++m) {
          sum += weight_[m] * looks_.basis[m][i] * looks_.basis[m][j];
        }
        for (size_t k = 0; k < j; ++k) sum -= lower_[i][k] * lower_[j][k];
        lower_[i][j] = i == j ? std::sqrt(sum) : sum / lower_[j][j];
      }
    }
  }

  void back(double* x) const {
    for (size_t i = 0; i < K; ++i) {
      for (size_t k = 0; k < i; ++k) x[i] -= lower_[i][k] * x[k];
      x[i] /= lower_[i][i];
    }
    for (size_t i = K; i-- > 0;) {
      for (size_t k = i + 1; k < K; ++k) x[i] -= lower_[k][i] * x[k];
      x[i] /= lower_[i][i];
    }
  }

  const Looks& looks_;
  bool metal_;
  double cosine_[kLooks], weight_[kLooks];
  Vec3 seen_[kLooks];
  double lower_[K][K] = {};
};

}  // namespace

std::vector<float> mirror(const std::vector<Dot>& dots, const std::vector<Vec3>& linear,
                          const Light& light, int threads, const Check& check) {
  std::vector<float> sh(dots.size() * K * 3);
  std::vector<std::pair<Cell, size_t>> glossy;
  for (size_t i = 0; i < dots.size(); ++i) {
    const Dot& d = dots[i];
    if (d.gloss > 0.02 && d.sigma_t == 0) {
      glossy.emplace_back(cell_of(d, light.ambience.cell, i), i);
      continue;
    }
    const Vec3 plain = displayed(linear[i]);
    for (size_t c = 0; c < 3; ++c)
      sh[3 * K * i + c] = static_cast<float>((plain[c] - 0.5) / sh_constant::k0);
  }
  std::sort(glossy.begin(), glossy.end());
  std::vector<size_t> starts;
  for (size_t k = 0; k < glossy.size(); ++k) {
    if (k == 0 || glossy[k].first != glossy[k - 1].first) starts.push_back(k);
  }
  starts.push_back(glossy.size());
  const Looks looks;
  parallel_for(threads, starts.size() - 1, 8, [&](size_t begin, size_t end) {
    call(check);
    for (size_t g = begin; g < end; ++g) {
      const Mirror cell(looks, light, dots[glossy[starts[g]].second]);
      for (size_t k = starts[g]; k < starts[g + 1]; ++k) {
        const size_t i = glossy[k].second;
        cell.solve(dots[i], linear[i], &sh[3 * K * i]);
      }
    }
  });
  return sh;
}

}  // namespace l4d::io::synth
