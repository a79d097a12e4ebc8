// SPDX-License-Identifier: Apache-2.0
#include "cli/command/failure.h"

#include <new>

#include "eval/errors.h"
#include "io/file/file.h"

namespace l4d::cli {

ExitCode exit_code_of(l4d_status status) {
  switch (status) {
    case L4D_OK:
      return kExitOk;
    case L4D_ERR_INVALID_ARGUMENT:
      return kExitUsage;
    case L4D_ERR_IO:
      return kExitIo;
    case L4D_ERR_NOT_L4D:
    case L4D_ERR_TRUNCATED:
    case L4D_ERR_CORRUPT:
    case L4D_ERR_CHECKSUM:
    case L4D_ERR_INVALID_SCENE:
      return kExitCorrupt;
    case L4D_ERR_VERSION_UNSUPPORTED:
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return kExitUnsupported;
    case L4D_ERR_LIMIT_EXCEEDED:
      return kExitLimit;
    case L4D_ERR_CANCELLED:
      return kExitCancelled;
    default:
      return kExitRuntime;
  }
}

Failure usage_error(const std::string& detail) { return Failure(kExitUsage, "USAGE", detail); }

bool has_renderer() {
#ifdef L4D_HAVE_RENDERER
  return true;
#else
  return false;
#endif
}

void require_renderer(const std::string& what) {
  if (has_renderer()) return;
  throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                "this build of l4dcodec has no renderer, which " + what + " needs");
}

Failure current_failure(const std::string& subject) {
  // Import errors begin with the path already.
  const auto prefixed = [&](const std::string& detail) {
    return subject.empty() || detail.compare(0, subject.size(), subject) == 0
               ? detail
               : subject + ": " + detail;
  };
  try {
    throw;
  } catch (const Failure& e) {
    return Failure(e.code(), e.name(), prefixed(e.what()));
  } catch (const io::Error& e) {
    return Failure(e.status(), prefixed(e.what()));
  } catch (const Error& e) {
    // Clauses of a format tell nothing of a file that is of none.
    const bool unknown = e.status() == L4D_ERR_NOT_L4D;
    return Failure(e.status(),
                   prefixed(unknown ? "this is no stream (.l4d) and no PLY" : eval::detail_of(e)));
  } catch (const std::bad_alloc&) {
    return Failure(L4D_ERR_OUT_OF_MEMORY, prefixed("out of memory"));
  } catch (const std::exception& e) {
    return Failure(L4D_ERR_INTERNAL, prefixed(e.what()));
  }
}

}  // namespace l4d::cli
