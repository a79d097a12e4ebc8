// SPDX-License-Identifier: Apache-2.0
#include "cli/command/process_group.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>

#ifdef L4D_HAVE_MPI
#include <mpi.h>
#endif

namespace l4d::cli {

#ifdef L4D_HAVE_MPI
namespace {

// A program that is not started by mpirun does not wake MPI up: that takes a second.
bool started_by_mpi() {
  const char* const signs[] = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "MPI_LOCALNRANKS"};
  return std::any_of(std::begin(signs), std::end(signs),
                     [](const char* name) { return std::getenv(name) != nullptr; });
}

int sum(void*, int64_t* values, uint64_t n) {
  // MPI counts in int.
  constexpr uint64_t kMost = uint64_t{1} << 27;
  for (uint64_t first = 0; first < n; first += kMost) {
    const int count = static_cast<int>(std::min(kMost, n - first));
    const int error =
        MPI_Allreduce(MPI_IN_PLACE, values + first, count, MPI_INT64_T, MPI_SUM, MPI_COMM_WORLD);
    if (error != MPI_SUCCESS) return error;
  }
  return 0;
}

}  // namespace

ProcessGroup::ProcessGroup() {
  if (!started_by_mpi()) return;
  int provided = 0;
  if (MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS) return;
  int rank = 0, count = 1;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &count);
  joined_ = true;
  rank_ = static_cast<uint32_t>(rank);
  count_ = static_cast<uint32_t>(count);
  MPI_Comm local;
  if (MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &local) ==
      MPI_SUCCESS) {
    MPI_Comm_rank(local, &rank);
    MPI_Comm_size(local, &count);
    local_rank_ = static_cast<uint32_t>(rank);
    local_count_ = static_cast<uint32_t>(count);
    MPI_Comm_free(&local);
  }
  handle_ = L4D_INIT(l4d_process_group);
  handle_.rank = rank_;
  handle_.count = count_;
  handle_.sum = sum;
}

ProcessGroup::~ProcessGroup() {
  int initialized = 0;
  MPI_Initialized(&initialized);
  if (initialized != 0) MPI_Finalize();
}

void ProcessGroup::abort(int exit_code) const {
  if (count_ > 1) MPI_Abort(MPI_COMM_WORLD, exit_code);
}
#else
ProcessGroup::ProcessGroup() = default;
ProcessGroup::~ProcessGroup() = default;
void ProcessGroup::abort(int) const {}
#endif

}  // namespace l4d::cli
