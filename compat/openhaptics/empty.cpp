// SPDX-License-Identifier: Apache-2.0
// Of libHDU.a, libHLU.a and libHL.so, which programs name when they link: nothing.
namespace {}
