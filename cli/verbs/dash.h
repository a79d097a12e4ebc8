// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/member_file.h"

namespace l4d::cli {

// An MPD of DASH that lists the media members of a file as segments, by their ranges of bytes. url:
// where players find the file.
std::string dash_manifest(const MemberFile& file, const std::string& url, bool complete);

}  // namespace l4d::cli
