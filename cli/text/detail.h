// SPDX-License-Identifier: Apache-2.0
// What verbs with --detail share.
#pragma once

#include <string>

#include "cli/common.h"
#include "l4d/decode.h"

namespace l4d::cli {

inline void add_detail_option(Verb* verb, std::string& detail) {
  verb->add_option("--detail", detail,
                   "full, or base: of a stream, base colours without the SH detail of its large "
                   "pages, which is not read then")
      ->type_name("NAME")
      ->one_of({"full", "base"})
      ->capture_default_str();
}

inline uint32_t detail_id(const std::string& detail) {
  return detail == "base" ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
}

}  // namespace l4d::cli
