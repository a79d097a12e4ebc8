// SPDX-License-Identifier: Apache-2.0
// The C++ runtime and Highway print why they end a program, and bring in all of printf for that. A
// module has nowhere to print: it traps, and its host sees where. The library writes its messages
// without printf (base/status.h).
#include <cstdarg>
#include <cstdio>

extern "C" {

[[noreturn]] void abort_message(const char*, ...) { __builtin_trap(); }

int fprintf(FILE*, const char*, ...) { __builtin_trap(); }

// What compilers for WebAssembly make of fprintf where no number has a fraction, and stand in for
// it.
int fiprintf(FILE*, const char*, ...) { __builtin_trap(); }
int __small_fprintf(FILE*, const char*, ...) { __builtin_trap(); }

int vsnprintf(char*, size_t, const char*, va_list) { __builtin_trap(); }

}  // extern "C"
