# SPDX-License-Identifier: Apache-2.0
# What the compiler can do against defects that its checks would have stopped: a stack that was
# written over ends the program when the function returns, and so do copies into buffers whose size
# is known and too small. What whoever builds has chosen in the flags of the compiler stays.
include(CheckCXXSourceCompiles)
include(CMakePushCheckState)
option(L4D_HARDENING "Compile in checks of the stack and of buffers, where the compiler has them" ON)

set(L4D_HARDENING_FLAGS "")
set(L4D_FORTIFY_LEVEL 0)
if(NOT L4D_HARDENING)
  return()
endif()

set(given_flags "${CMAKE_C_FLAGS} ${CMAKE_CXX_FLAGS}")
foreach(config IN ITEMS RELEASE RELWITHDEBINFO MINSIZEREL)
  string(APPEND given_flags " ${CMAKE_C_FLAGS_${config}} ${CMAKE_CXX_FLAGS_${config}}")
endforeach()

# A flag is taken where a program links without it: whoever links a static library does not give it.
# What is ignored with a warning is none that the compiler has.
function(l4d_harden flag name)
  if(given_flags MATCHES "${name}")
    return()
  endif()
  set(CMAKE_REQUIRED_DEFINITIONS ${flag} -Werror)
  string(MAKE_C_IDENTIFIER "L4D_HAS_${name}" has)
  string(TOUPPER ${has} has)
  check_cxx_source_compiles("#include <cstring>
int main(int argc, char** argv) {
  char text[64];
  std::strncpy(text, argv[argc - 1], sizeof text - 1);
  text[63] = 0;
  return static_cast<int>(std::strlen(text));
}" ${has})
  if(${has})
    list(APPEND L4D_HARDENING_FLAGS ${flag})
    set(L4D_HARDENING_FLAGS ${L4D_HARDENING_FLAGS} PARENT_SCOPE)
  endif()
endfunction()
l4d_harden(-fstack-protector-strong stack-protector)
# Windows commits a stack page by page itself, and GCC fails on large frames there (internal error in
# seh_emit_stackalloc).
if(NOT WIN32)
  l4d_harden(-fstack-clash-protection stack-clash-protection)
endif()
l4d_harden(-fcf-protection cf-protection)

# Sanitizers watch the functions that FORTIFY_SOURCE would replace. Compilers that set a level by
# themselves do so where they optimise.
if(NOT L4D_SANITIZE AND NOT given_flags MATCHES "-fsanitize|_FORTIFY_SOURCE")
  cmake_push_check_state(RESET)
  set(CMAKE_REQUIRED_DEFINITIONS -O2)
  check_cxx_source_compiles("#ifdef _FORTIFY_SOURCE
#error
#endif
int main() {}" L4D_FORTIFY_IS_FREE)
  foreach(level IN ITEMS 3 2)
    if(L4D_FORTIFY_IS_FREE AND L4D_FORTIFY_LEVEL EQUAL 0)
      set(CMAKE_REQUIRED_DEFINITIONS -O2 -D_FORTIFY_SOURCE=${level})
      check_cxx_source_compiles("#include <cstring>
static_assert(__USE_FORTIFY_LEVEL == ${level}, \"\");
int main() {}" L4D_HAS_FORTIFY_${level})
      if(L4D_HAS_FORTIFY_${level})
        set(L4D_FORTIFY_LEVEL ${level})
      endif()
    endif()
  endforeach()
  cmake_pop_check_state()
endif()
