/* SPDX-License-Identifier: Apache-2.0
 * A stranger's C99 program that links the decoder alone: what is no stream is refused. */
#include <l4d/decode.h>
#include <stdio.h>

int main(void) {
  static const unsigned char bytes[64] = {'n', 'o'};
  l4d_decoder* decoder = NULL;
  l4d_status status;
  if (l4d_decoder_create(NULL, &decoder) != L4D_OK) return 1;
  status = l4d_decoder_open_memory(decoder, bytes, sizeof bytes);
  printf("%s: %s\n", l4d_status_name(status), l4d_last_error_message());
  l4d_decoder_destroy(decoder);
  return status == L4D_ERR_NOT_L4D ? 0 : 2;
}
