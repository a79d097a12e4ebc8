// SPDX-License-Identifier: Apache-2.0
// What is shown when: the members of a playlist, or the only stream, on one timeline. Times are
// seconds of the presentation.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "decoder/playback/part.h"
#include "decoder/playback/path.h"
#include "decoder/playback/playlist.h"

namespace l4d::playback {

class Presentation {
 public:
  Presentation(Blocks& pool, Decoders& decoders) : pool_(pool), decoders_(decoders) {}

  void close();
  // One stream, which begins and ends at 0 until its header is here. Returns its part.
  Part& open_stream(uint64_t file_size);
  void set_stream_span(double begin, double end);
  void open_playlist();
  // The playlist as it is now. Members that have left its front stay if they end after `time`.
  void set_list(Playlist&& list, double time);

  bool is_playlist() const { return is_playlist_; }
  const Playlist& list() const { return list_; }
  const std::string& uri_of(const Member& member) const { return list_.uris[member.uri]; }
  bool has_media() const { return !media_.empty(); }
  // Of the playlist, less what left its front.
  double begin() const { return begin_; }
  double end() const { return media_.empty() ? begin_ : media(media_.size() - 1).end; }

  // ---- media members, in the order of time
  size_t num_media() const { return media_.size(); }
  const Member& media(size_t k) const { return list_.members[media_[k]]; }
  // The one of a time: where there is none, the one whose span is nearest. There is one.
  size_t media_at(double time) const;
  // From when to when a media member is shown: with half of the gaps around it.
  Interval shown_of(size_t k) const;

  // ---- parts
  // Of the members that the k-th media member shows; null: not open.
  void find_parts(size_t k, std::vector<Part*>* out) const;
  // Gives the parts of the members that a path shows their segments, and takes those of others.
  // Opens what is not open. *out: the parts on the path, in its order.
  void lay(const std::vector<Segment>& path, std::vector<Part*>* out);
  Part* find(uint32_t number) const;
  const std::vector<std::unique_ptr<Part>>& parts() const { return parts_; }
  void free_part(const Part* part);
  // Nothing is known of its file any more, nor are its bytes here.
  void renew(Part* part);
  // The most rungs of a stream that was open so far; the highest degree of SH.
  uint32_t num_rungs() const { return num_rungs_; }
  uint32_t sh_degree() const { return sh_degree_; }
  void meet(const Part& part);

 private:
  Part& make_part(const Member& member);
  uint32_t take_slot();
  void add_stage(size_t k, const Segment& segment, std::vector<Part*>* out);
  void index_media();
  void keep_front(double time, Playlist* next) const;

  Blocks& pool_;
  Decoders& decoders_;
  bool is_playlist_ = false;
  Playlist list_;
  std::vector<uint32_t> media_;  // in list_.members
  double begin_ = 0;
  std::vector<std::unique_ptr<Part>> parts_;
  uint32_t next_slot_ = 0;
  uint64_t uses_ = 0;
  uint32_t num_rungs_ = 1, sh_degree_ = 0;
};

}  // namespace l4d::playback
