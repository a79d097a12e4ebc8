# SPDX-License-Identifier: Apache-2.0
# Highway 1.0 is older than engines with all of WebAssembly's SIMD: it looks bytes up, and makes bits
# of masks, one by one through memory. Engines of today have an instruction for each.
# make_highway_wasm(FROM TO): writes Highway's header FROM, with these instructions, to TO.
function(make_highway_wasm from to)
  file(READ ${from} text)
  macro(replace_once old new)
    string(FIND "${text}" "${old}" first)
    string(FIND "${text}" "${old}" last REVERSE)
    if(first EQUAL -1 OR NOT first EQUAL last)
      message(FATAL_ERROR "${from} is not what Highway 1.0 has: not once in it\n${old}")
    endif()
    string(REPLACE "${old}" "${new}" text "${text}")
  endmacro()
  replace_once("#if 0\n  return Vec128<TI, NI>{wasm_i8x16_swizzle"
               "#if 1\n  return Vec128<TI, NI>{wasm_i8x16_swizzle")
  replace_once("  const __i32x4 mask_i =" "  return wasm_i32x4_bitmask(mask.raw);\n  const __i32x4 mask_i =")
  # Written when it differs, so that nothing is built again for a time stamp.
  file(WRITE ${to}.new "${text}")
  file(COPY_FILE ${to}.new ${to} ONLY_IF_DIFFERENT)
endfunction()
