// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a session: those of the piece at hand, and those before it that live on.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "encoder/prepare/scene.h"
#include "encoder/session/pooled_gaussian.h"
#include "l4d/attributes.hpp"

namespace l4d {

class SessionPool {
 public:
  // That so many Gaussians take, with the arrays of `input` and those that are here.
  uint64_t bytes_of(const EncoderInput& input, size_t count) const;

  // Adds a scene that `prepared` was made of, but for the Gaussians that are here already. Fails
  // with INVALID_ARGUMENT if it has other arrays than those before.
  Status add(const EncoderInput& input, const EncoderScene& prepared, bool lossless);
  void keep(const std::vector<char>& mask);

  size_t count() const { return rows_.size(); }
  const std::vector<PooledGaussian>& rows() const { return rows_; }
  std::vector<PooledGaussian>& rows() { return rows_; }

 private:
  friend class SessionScene;

  // Drops what is the same as one of the first `before` rows.
  void drop_known(size_t before);

  std::vector<PooledGaussian> rows_;
  AttributeArrays arrays_;  // all of them, times always as binary64
  bool has_double_times_ = false;
  bool has_windows_ = false;
  std::array<std::vector<float>, L4D_WEIGHT_COUNT> weights_;
  std::vector<float> min_sizes_;
  std::vector<float> stated_opacity_;  // as EncoderInput has it; empty: of no Gaussian
  uint32_t metric_ = 0;                // of weights
  // Of the first piece: later ones hold only what is new, which is a part of the image.
  double sum_of_estimates_ = 0;
};

// Some of the Gaussians as a scene of its own.
class SessionScene {
 public:
  // price_seconds: what importances are averages over.
  SessionScene(const SessionPool& pool, const std::vector<uint32_t>& rows,
               const l4d_timeline& timeline, double price_seconds);
  SessionScene(const SessionScene&) = delete;
  SessionScene& operator=(const SessionScene&) = delete;

  // Borrows the arrays. `like`: what it has in common with the piece.
  EncoderInput input(const EncoderInput& like) const;

 private:
  l4d_timeline timeline_;
  AttributeArrays arrays_;
  std::array<std::vector<float>, L4D_WEIGHT_COUNT> weights_;
  uint32_t metric_;
  std::vector<float> min_sizes_, stated_opacity_, exposure_;
  std::vector<double> share_;
};

}  // namespace l4d
