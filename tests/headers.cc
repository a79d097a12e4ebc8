// SPDX-License-Identifier: Apache-2.0
// The program whose precompiled headers the tests take (tests/CMakeLists.txt).
int main() { return 0; }
