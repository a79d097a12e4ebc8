/* SPDX-License-Identifier: Apache-2.0
 * export.h: L4D_API, which marks the functions that the libraries offer to programs.
 *
 * On ELF and Mach-O it means the same in static and in shared libraries, and nothing has to be
 * defined. On Windows a program that links the static libraries defines L4D_STATIC_DEFINE; the
 * CMake package and the pkg-config files do that. The build of the shared libraries defines
 * L4D_EXPORTS.
 */
#ifndef L4D_EXPORT_H
#define L4D_EXPORT_H

#if defined(_WIN32) || defined(__CYGWIN__)
#if defined(L4D_STATIC_DEFINE)
#define L4D_API
#elif defined(L4D_EXPORTS)
#define L4D_API __declspec(dllexport)
#else
#define L4D_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define L4D_API __attribute__((visibility("default")))
#else
#define L4D_API
#endif

#endif
