// SPDX-License-Identifier: Apache-2.0
#include "io/formats/fdgs_records.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "io/file/file.h"

namespace l4d::io::fdgs {
namespace {

constexpr uint64_t kRecordHeader = 9;  // opcode and length
// Deflated data do not shrink further, and chunks of .4dgs are hardly compressible.
constexpr uint64_t kMostGaussiansPerByte = 1024;

class Walk {
 public:
  Walk(const std::vector<uint8_t>& bytes, std::string path)
      : bytes_(bytes), path_(std::move(path)) {}

  Contents run() {
    check_magic();
    uint64_t at = kMagic.size();
    bool ended = false;
    while (!ended) {
      const uint64_t left = bytes_.size() - at;
      if (left < kRecordHeader) fail("it ends early");
      const uint8_t opcode = bytes_[static_cast<size_t>(at)];
      Fields length(&bytes_[static_cast<size_t>(at) + 1], 8, path_);
      const uint64_t size = length.u64();
      if (size > left - kRecordHeader) fail("a record reaches beyond the file");
      if (at == kMagic.size() && opcode != kHeader) fail("its first record is no header");
      Fields fields(bytes_.data() + at + kRecordHeader, size, path_);
      read_record(opcode, at, &fields);
      ended = opcode == kFooter;
      at += kRecordHeader + size;
    }
    if (bytes_.size() - at != kMagic.size() ||
        std::memcmp(&bytes_[static_cast<size_t>(at)], kMagic.data(), kMagic.size()) != 0) {
      fail("what is behind its footer is not the end of a .4dgs file");
    }
    finish();
    return std::move(out_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(L4D_ERR_CORRUPT, path_ + ": " + message);
  }
  [[noreturn]] void refuse(const std::string& message) const {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": " + message);
  }

  void check_magic() const {
    if (bytes_.size() < kMagic.size()) fail("no .4dgs file: it is shorter than its first bytes");
    std::array<uint8_t, kMagic.size()> magic;
    std::copy_n(bytes_.begin(), magic.size(), magic.begin());
    const uint8_t version = std::exchange(magic[kVersionByte], kMagic[kVersionByte]);
    if (magic != kMagic) fail("no .4dgs file");
    if (version != kMagic[kVersionByte]) {
      refuse("version " + std::to_string(version - '0') + " of .4dgs; 1 is read");
    }
  }

  void read_record(uint8_t opcode, uint64_t at, Fields* fields) {
    switch (opcode) {
      case kHeader:
        return read_header(at, fields);
      case kFooter:
        return check_summary(at, fields);
      case kQuantization:
        return read_grids(fields);
      case kWindowTable:
        return read_windows(fields);
      case kChunk:
        return read_chunk(fields);
      case kShBand:
        return read_band(fields);
      case kMetadata:
        fields->text();
        for (const auto& [key, text] : fields->texts()) out_.attributes.emplace(key, text);
        return;
      case kCoordinateFrame:
        return read_frame(fields);
      case kObjectTrack:
        return read_track(fields);
      case kDeltaChunk:
        refuse("a .4dgs file with delta chunks; chunks of whole Gaussians are read");
      case kChunkIndex:
      case kStatistics:
      case kSummaryOffset:
        return;
      case kAudio:
      case kAudioSource:
      case kAudioData:
        return note("sound");
      case kCamera:
        return read_view(fields);
      default:
        return note("records of kind " + std::to_string(opcode));
    }
  }

  void note(const std::string& kind) {
    if (std::find(out_.unread.begin(), out_.unread.end(), kind) == out_.unread.end()) {
      out_.unread.push_back(kind);
    }
  }

  void read_header(uint64_t at, Fields* fields) {
    if (at != kMagic.size()) fail("it has a second header");
    fields->text();  // profile
    fields->text();  // what wrote it
    out_.seconds = fields->f64();
    out_.count = fields->u64();
    out_.cutoff = fields->f64();
    const std::string model = fields->text();
    fields->bytes(6 * sizeof(double));  // bounds
    out_.sh_degree = fields->u8();
    fields->u8();
    out_.attributes = fields->texts();
    if (model != kTemporalModel) {
      refuse("a .4dgs file of the temporal model '" + model + "'; " + kTemporalModel + " is read");
    }
    if (out_.sh_degree > 3) {
      refuse("spherical harmonics of degree " + std::to_string(out_.sh_degree));
    }
    if (!(out_.cutoff >= 0 && out_.cutoff <= 1)) fail("its cutoff is not within 0 to 1");
  }

  void read_grids(Fields* fields) {
    if (has_grids_) fail("it has a second record of quantization");
    has_grids_ = true;
    const std::string scheme = fields->text();
    if (scheme != kScheme) {
      refuse("the quantization '" + scheme + "' of .4dgs; " + kScheme + " is read");
    }
    Grids& g = out_.grids;
    for (double& x : g.origin) x = fields->f64();
    bool finite =
        std::all_of(g.origin.begin(), g.origin.end(), [](double x) { return std::isfinite(x); });
    for (double* step : {&g.position, &g.scale_log, &g.rotation, &g.color, &g.opacity, &g.motion,
                         &g.time, &g.sigma_log}) {
      *step = fields->f64();
      finite = finite && std::isfinite(*step) && *step >= 0;
    }
    if (!finite) fail("a step of its quantization is no number");
  }

  void read_windows(Fields* fields) {
    const uint32_t count = fields->u32();
    if (count > fields->left() / (2 * sizeof(double))) fail("its table of windows ends early");
    out_.windows.clear();
    for (uint32_t k = 0; k < count; ++k) {
      Window w;
      w.begin = fields->f64();
      w.end = fields->f64();
      out_.windows.push_back(w);
    }
  }

  void read_chunk(Fields* fields) {
    ChunkPlace chunk;
    fields->bytes(2 * sizeof(double) + 4);  // interval and level
    chunk.count = fields->u32();
    chunk.compression = fields->text();
    chunk.expanded = fields->u64();
    chunk.bytes = fields->u64();
    chunk.data = fields->bytes(chunk.bytes);
    if (chunk.count > kMostGaussiansPerByte * chunk.bytes) {
      fail("a chunk of " + std::to_string(chunk.bytes) + " bytes promises " +
           std::to_string(chunk.count) + " Gaussians");
    }
    if (chunk.compression.empty() && chunk.expanded != chunk.bytes) {
      fail("a chunk states another length than it has");
    }
    found_ += chunk.count;
    out_.chunks.push_back(std::move(chunk));
  }

  // Of the chunk before it, whatever the attribute that its stream names.
  void read_band(Fields* fields) {
    const uint8_t band = fields->u8();
    if (band < 1 || band > 3 || out_.chunks.empty()) fail("a band of spherical harmonics is lost");
    PackedStream& place = out_.chunks.back().bands[band - 1];
    if (place.payload != nullptr) fail("a chunk has a band of spherical harmonics twice");
    place = next_stream(fields);
    if (place.count != out_.chunks.back().count || place.channels != 3 * (2 * band + 1)) {
      fail("a band of spherical harmonics does not fit its chunk");
    }
  }

  // The frame without a name is that of the scene.
  void read_frame(Fields* fields) {
    if (!fields->text().empty()) return note("further coordinate frames");
    const uint8_t handedness = fields->u8(), up = fields->u8(), forward = fields->u8();
    fields->u8();  // the unit's name; its length decides
    out_.metres_per_unit = fields->f64();
    if (up % 3 == forward % 3) fail("up and forward of its coordinate frame are one axis");
    if (!(out_.metres_per_unit >= 0 && std::isfinite(out_.metres_per_unit))) {
      fail("the unit of its coordinate frame is no length");
    }
    constexpr uint8_t kRightHanded = 1, kUp = 1, kForward = 2, kDown = 4, kBack = 5;
    out_.coordinate_system = L4D_COORDINATES_UNKNOWN;
    if (handedness == kRightHanded && up == kUp && forward == kBack) {
      out_.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
    } else if (handedness == kRightHanded && up == kDown && forward == kForward) {
      out_.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
    }
    has_frame_ = true;
    out_.has_other_axes = out_.coordinate_system == L4D_COORDINATES_UNKNOWN;
  }

  void read_view(Fields* fields) {
    out_.view.fov_degrees = fields->f64();
    for (double& x : out_.view.position) x = fields->f64();
    for (double& x : out_.view.target) x = fields->f64();
    if (fields->u32() > 0) note("a camera path");
  }

  void read_track(Fields* fields) {
    const uint32_t object = fields->u32();
    fields->u8();
    if (fields->u32() > 0) out_.moved_objects.insert(object);
  }

  // The checksum is over all from the first index to the footer.
  void check_summary(uint64_t footer, Fields* fields) const {
    const uint64_t begin = fields->u64();
    fields->u64();
    const uint32_t stated = fields->u32();
    if (begin == 0) return;
    if (begin > footer || begin < kMagic.size()) fail("its footer names no place of the index");
    if (stated == 0) return;
    uLong crc = crc32(0, nullptr, 0);
    for (uint64_t at = begin; at < footer;) {
      const uint64_t size = std::min<uint64_t>(footer - at, uint64_t{1} << 20);
      crc = crc32(crc, &bytes_[static_cast<size_t>(at)], static_cast<uInt>(size));
      at += size;
    }
    if (crc != stated) fail("its index does not have the checksum that the footer states");
  }

  void finish() {
    if (!has_grids_ && !out_.chunks.empty()) fail("its record of quantization is missing");
    if (out_.windows.empty()) out_.windows.push_back({});  // as the format wants it
    if (found_ != out_.count) {
      fail("its chunks have " + std::to_string(found_) + " Gaussians, and the file should have " +
           std::to_string(out_.count));
    }
    for (const ChunkPlace& chunk : out_.chunks) {
      for (uint32_t band = 0; band < out_.sh_degree; ++band) {
        if (chunk.count > 0 && chunk.bands[band].payload == nullptr) {
          fail("a chunk lacks a band of spherical harmonics");
        }
      }
    }
    // Only where there is no frame, as the format says.
    const auto system = out_.attributes.find("coordinate_system");
    if (!has_frame_ && system != out_.attributes.end()) {
      const bool is_known = system->second == "y-up-right-handed";
      out_.coordinate_system = is_known ? L4D_COORDINATES_RIGHT_UP_BACK : L4D_COORDINATES_UNKNOWN;
      out_.has_other_axes = !is_known;
    }
  }

  const std::vector<uint8_t>& bytes_;
  std::string path_;
  Contents out_;
  bool has_grids_ = false, has_frame_ = false;
  uint64_t found_ = 0;  // Gaussians
};

}  // namespace

Contents walk_records(const std::vector<uint8_t>& bytes, const std::string& path) {
  return Walk(bytes, path).run();
}

}  // namespace l4d::io::fdgs
