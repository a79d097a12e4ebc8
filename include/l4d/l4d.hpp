// SPDX-License-Identifier: Apache-2.0
// l4d.hpp: the C++17 headers over the C API, as far as they are installed. Each mirrors the C
// header of its name; handles own what they wrap, and functions that can fail throw l4d::Error. A
// function without a method takes handle.get().
#ifndef L4D_L4D_HPP
#define L4D_L4D_HPP

#include "l4d/decode.hpp"
#include "l4d/members.hpp"
#include "l4d/playback.hpp"
#if __has_include("l4d/encode.hpp")
#include "l4d/encode.hpp"
#endif

#endif  // L4D_L4D_HPP
