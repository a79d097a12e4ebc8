// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <new>
#include <string>

#include "io/scene/scene.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {

// What went wrong, without the name of the status that what() begins with.
inline std::string detail_of(const Error& error) {
  const std::string name = l4d_status_name(error.status());
  std::string detail = error.what();
  if (detail.compare(0, name.size(), name) == 0) detail.erase(0, name.size());
  if (detail.compare(0, 2, ": ") == 0) detail.erase(0, 2);
  return detail.empty() ? l4d_status_description(error.status()) : detail;
}

// Calls body(). Failures of the library and of memory come out as io::Error that begins with
// `subject`, since an evaluation has several streams and scenes; others come out as they are.
template <typename Body>
auto about(const std::string& subject, const Body& body) {
  try {
    return body();
  } catch (const Error& error) {
    throw io::Error(error.status(), subject + ": " + detail_of(error));
  } catch (const std::bad_alloc&) {
    throw io::Error(L4D_ERR_OUT_OF_MEMORY, subject + ": out of memory");
  }
}

}  // namespace l4d::eval
