// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/find_codebook.h"

#include "l4d/experimental/packed.h"

namespace l4d {

Status find_codebook(SceneFile& file, uint32_t layer, uint32_t component, uint32_t stage,
                     uint32_t block, l4d_codebook* out) {
  const SceneHeader& header = file.header();
  if (layer >= header.layers.size() || component >= L4D_COMPONENT_COUNT ||
      stage >= L4D_MAX_STAGES) {
    return invalid_argument("no such layer, component or stage");
  }
  file.retry();
  const ComponentCoding& coding = header.component(header.layers[layer], component);
  out->entries = nullptr;
  out->num_entries = 0;
  out->dim = header.component_dim(header.layers[layer], component);
  if (stage >= coding.stages.size()) return {};
  const CodebookData* codebook = nullptr;
  if (block == L4D_NO_BLOCK || stage > 0) {
    L4D_RETURN_IF_ERROR(file.codebooks().codebook(layer, component, stage, &codebook));
  } else {
    const uint32_t directory_index = block >> 8;
    const uint32_t index = block & 0xff;
    if (directory_index >= num_directory_pages(header.layers[layer])) {
      return invalid_argument("no such block");
    }
    DirectoryPageRef read;
    L4D_RETURN_IF_ERROR(file.directory().page(layer, directory_index, &read));
    if (index >= read->page.blocks.size()) return invalid_argument("no such block");
    const RcqTableRef& table = read->page.blocks[index].tables[component];
    if (table.num_entries == 0) {
      L4D_RETURN_IF_ERROR(file.codebooks().codebook(layer, component, stage, &codebook));
    } else {
      L4D_RETURN_IF_ERROR(file.codebooks().block_codebook({layer, directory_index, index},
                                                          component, table, &codebook));
    }
  }
  out->entries = codebook->entries.data();
  out->num_entries = codebook->num_entries;
  return {};
}

}  // namespace l4d
