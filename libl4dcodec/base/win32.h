// SPDX-License-Identifier: Apache-2.0
// What the file code of Windows shares. Included there alone.
#pragma once

#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>

#include <string>
#include <system_error>

namespace l4d {

// UTF-8 as the system's own functions take it.
inline std::wstring wide(const std::string& text) {
  const int n = static_cast<int>(text.size());
  std::wstring out(text.size(), L'\0');  // never longer than the UTF-8
  const int size = n == 0 ? 0 : ::MultiByteToWideChar(CP_UTF8, 0, text.data(), n, &out[0], n);
  out.resize(static_cast<size_t>(size));
  return out;
}

inline std::string last_error_text() {
  return std::system_category().message(static_cast<int>(::GetLastError()));
}

}  // namespace l4d
