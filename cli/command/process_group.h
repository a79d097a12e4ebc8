// SPDX-License-Identifier: Apache-2.0
// The processes of one command under mpirun. Rank 0 does what the command says; the others help it
// with what can be shared, which is importance, and print nothing.
#pragma once

#include <cstdint>
#include <memory>

#include "l4d/render.h"

namespace l4d::cli {

class ProcessGroup {
 public:
  // Joins the others where the environment says that there are any and this build has MPI.
  ProcessGroup();
  ~ProcessGroup();
  ProcessGroup(const ProcessGroup&) = delete;
  ProcessGroup& operator=(const ProcessGroup&) = delete;

  uint32_t rank() const { return rank_; }
  uint32_t count() const { return count_; }
  // Of the ranks of this machine, in their order: who takes which device, and how many share its
  // cores.
  uint32_t local_rank() const { return local_rank_; }
  uint32_t local_count() const { return local_count_; }
  bool helps() const { return rank_ > 0; }
  // For the library; null where the command was not started for ranks. One rank alone has it too,
  // so that it measures what several do.
  const l4d_process_group* handle() const { return joined_ ? &handle_ : nullptr; }
  // Ends all ranks, since those that wait for this one would wait for ever. Returns where there is
  // one.
  void abort(int exit_code) const;

 private:
  bool joined_ = false;
  uint32_t rank_ = 0, count_ = 1;
  uint32_t local_rank_ = 0, local_count_ = 1;
  l4d_process_group handle_{};
};

}  // namespace l4d::cli
