// SPDX-License-Identifier: Apache-2.0
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cstring>
#include <string>

#include "l4d/decode.h"
#include "l4d/experimental/inspect.h"
#include "l4d/l4d.h"
#include "libl4dcodec/base/c_api.h"

#define L4D_STRING_(x) #x
#define L4D_STRING(x) L4D_STRING_(x)

namespace {

// Of a fixed size, so that no thread holds memory for it and saying what failed cannot fail itself.
struct ErrorMessage {
  char text[1024] = "";
};
ErrorMessage& last_error_message() {
  thread_local ErrorMessage message;
  return message;
}

}  // namespace

extern "C" {

void l4d_keep_error_message_(const char* message) {
  char* text = last_error_message().text;
  const size_t length = std::min(std::strlen(message), sizeof(ErrorMessage::text) - 1);
  std::memmove(text, message, length);
  text[length] = 0;
}

const char* l4d_last_error_message(void) { return last_error_message().text; }

uint32_t l4d_version_number(void) {
  return uint32_t{L4D_VERSION_MAJOR} << 24 | uint32_t{L4D_VERSION_MINOR} << 16 |
         uint32_t{L4D_VERSION_PATCH} << 8;
}

const char* l4d_version_string(void) {
  return L4D_STRING(L4D_VERSION_MAJOR) "." L4D_STRING(L4D_VERSION_MINOR) "." L4D_STRING(
      L4D_VERSION_PATCH);
}

const char* l4d_build_info(void) {
  static const std::string kInfo = [] {
    std::string s = "compiler " __VERSION__;
    s += "; simd";
    const int64_t supported = hwy::SupportedTargets() & HWY_TARGETS;
    for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) {
      const int64_t target = rest & -rest;
      s += std::string(" ") + hwy::TargetName(target);
      if ((supported & target) == 0) s += "(absent)";
    }
    const int64_t best = supported & -supported;
    s += std::string("; using ") + hwy::TargetName(best);
#ifdef L4D_HAVE_CUDA
    s += "; cuda";
#endif
#ifdef L4D_OPENMP
    s += "; openmp";
#endif
    return s;
  }();
  return kInfo.c_str();
}

const char* l4d_status_name(l4d_status status) {
  switch (status) {
#define L4D_CASE(name) \
  case name:           \
    return #name;
    L4D_CASE(L4D_OK)
    L4D_CASE(L4D_ERR_INVALID_ARGUMENT)
    L4D_CASE(L4D_ERR_INVALID_STATE)
    L4D_CASE(L4D_ERR_OUT_OF_MEMORY)
    L4D_CASE(L4D_ERR_IO)
    L4D_CASE(L4D_ERR_CANCELLED)
    L4D_CASE(L4D_ERR_LIMIT_EXCEEDED)
    L4D_CASE(L4D_ERR_INVALID_SCENE)
    L4D_CASE(L4D_ERR_BUFFER_TOO_SMALL)
    L4D_CASE(L4D_ERR_NEED_DATA)
    L4D_CASE(L4D_ERR_NOT_L4D)
    L4D_CASE(L4D_ERR_VERSION_UNSUPPORTED)
    L4D_CASE(L4D_ERR_FEATURE_UNSUPPORTED)
    L4D_CASE(L4D_ERR_TRUNCATED)
    L4D_CASE(L4D_ERR_CORRUPT)
    L4D_CASE(L4D_ERR_CHECKSUM)
    L4D_CASE(L4D_ERR_DEVICE)
    L4D_CASE(L4D_ERR_INTERNAL)
#undef L4D_CASE
    default:
      return "L4D_ERR_UNKNOWN";
  }
}

const char* l4d_status_description(l4d_status status) {
  switch (status) {
    case L4D_OK:
      return "The call succeeded.";
    case L4D_ERR_INVALID_ARGUMENT:
      return "An argument is not what the function's contract asks for.";
    case L4D_ERR_INVALID_STATE:
      return "The handle is not in a state in which this call makes sense.";
    case L4D_ERR_OUT_OF_MEMORY:
      return "The host could not provide memory.";
    case L4D_ERR_IO:
      return "Reading or writing failed.";
    case L4D_ERR_CANCELLED:
      return "The progress callback cancelled the call.";
    case L4D_ERR_LIMIT_EXCEEDED:
      return "The stream needs more than the limits allow; raise them if you trust it.";
    case L4D_ERR_INVALID_SCENE:
      return "The scene holds values that cannot be coded.";
    case L4D_ERR_BUFFER_TOO_SMALL:
      return "An array of the caller's is too small for the result.";
    case L4D_ERR_NEED_DATA:
      return "Bytes that the call needs are not here yet.";
    case L4D_ERR_NOT_L4D:
      return "The data is not an .l4d stream.";
    case L4D_ERR_VERSION_UNSUPPORTED:
      return "The stream has a major version this library does not read.";
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return "The stream uses a coding tool this library does not have.";
    case L4D_ERR_TRUNCATED:
      return "The stream ends before data it refers to.";
    case L4D_ERR_CORRUPT:
      return "The stream violates the specification.";
    case L4D_ERR_CHECKSUM:
      return "Stored bytes do not match their checksum; the stream is damaged.";
    case L4D_ERR_DEVICE:
      return "There is no usable device, or the device's runtime failed.";
    case L4D_ERR_INTERNAL:
      return "A defect of the library; please report it.";
    default:
      return "Not a status of this library.";
  }
}

const char* l4d_section_name(uint32_t section) {
  static constexpr const char* kNames[L4D_SECTION_COUNT] = {
      "header",   "directory",     "codebooks",      "rcq_tables",    "page_overhead",
      "position", "mean_t",        "opacity",        "scale_factor",  "sh",
      "scale",    "rotor_spatial", "rotor_temporal", "entropy_tables"};
  return section < L4D_SECTION_COUNT ? kNames[section] : nullptr;
}

}  // extern "C"
