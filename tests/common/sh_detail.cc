// SPDX-License-Identifier: Apache-2.0
#include "tests/common/sh_detail.h"

#include <stdexcept>

#include "encoder/file/entropy_model.h"

namespace l4d::test {
namespace {

void require(const Status& s) {
  if (!s.ok()) throw std::runtime_error(s.detail());
}

struct CodedPage {
  EditedDirectoryPage* directory;
  size_t index;
  PageColumns columns;
};

std::vector<CodedPage> decode_pages(const SceneHeader& header, const LayerHeader& layer,
                                    EditedLayer* edited) {
  EntropyTables tables;
  require(parse_entropy_tables(edited->entropy.raw, 0, header, layer, &tables));
  RansDecoder decoder;
  decoder.kernels = &rans_kernels_reference();
  decoder.streams = &stream_kernels_reference();
  std::vector<CodedPage> pages;
  for (EditedDirectoryPage& d : edited->directory) {
    for (size_t p = 0; d.present && p < d.pages.size(); ++p) {
      if (d.pages[p].codec != static_cast<uint32_t>(ChunkCodec::kRans32)) continue;
      const PageRecord& record = d.page.pages[p];
      if (record.has_sh_detail()) throw std::runtime_error("the page has an SH chunk already");
      const BlockRecord* block = record.block == kNoBlock ? nullptr : &d.page.blocks[record.block];
      RansPageChunks parts;
      parts.first = d.pages[p].raw;
      PageColumns columns;
      RansPage page{&decoder, parts, block, record.num_gaussians, &columns};
      decode_rans_page(header, layer, tables, PageWants(), &page);
      require(page.status);
      pages.push_back({&d, p, std::move(columns)});
    }
  }
  return pages;
}

}  // namespace

Bytes with_sh_detail(const Bytes& file, unsigned sh_base,
                     const std::function<void(PageColumns&)>& edit) {
  StreamEditor editor(file);
  const SceneHeader before = editor.header;
  editor.header.sh_base = sh_base;
  for (size_t l = 0; l < editor.layers.size(); ++l) {
    const LayerHeader& layer = editor.header.layers[l];
    if (!layer.has_entropy) continue;
    std::vector<CodedPage> pages = decode_pages(before, layer, &editor.layers[l]);
    const std::vector<ChannelSpec> channels = page_channels(editor.header, layer);
    TokenCounts counts(channels);
    for (CodedPage& page : pages) {
      if (edit) edit(page.columns);
      visit_channels(editor.header, layer, channels, page.columns, counts);
    }
    const EntropyModel model(channels, counts);
    editor.layers[l].entropy.raw = model.serialize();
    editor.layers[l].entropy.codec = 0;
    for (const CodedPage& page : pages) {
      EditedChunk& detail = page.directory->details[page.index];
      page.directory->pages[page.index].raw =
          model.encode_page(editor.header, layer, page.columns, &detail.raw);
    }
  }
  return editor.build();
}

std::vector<PageRecord> page_records(const Bytes& file) {
  std::vector<PageRecord> records;
  for (const EditedLayer& layer : StreamEditor(file).layers) {
    for (const EditedDirectoryPage& d : layer.directory) {
      if (d.present) records.insert(records.end(), d.page.pages.begin(), d.page.pages.end());
    }
  }
  return records;
}

}  // namespace l4d::test
