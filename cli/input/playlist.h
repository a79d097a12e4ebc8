// SPDX-License-Identifier: Apache-2.0
// HLS playlists of files of several streams: `manifest` writes them, and `encode --live` while the
// file grows.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "cli/input/member_file.h"

namespace l4d::cli {

// Where a playlist that lies in `folder` finds a file: a relative reference of RFC 3986.
std::string reference_to(const std::string& name, const std::filesystem::path& folder);

// Throws a usage error where a URL cannot stand in a playlist.
void check_url(const std::string& url);

// complete: nothing is appended any more. stream: what all members have in common. longest: seconds
// of a segment, or less than those that are there.
std::string playlist_of(const std::vector<MemberInfo>& members, bool complete,
                        const std::string& url, uint64_t stream, double longest = 0);

}  // namespace l4d::cli
