// Scattered places in one frame: 0403 (random read), 0406 (blocks) and 1402 (random write). For the
// codec's own files.
// Source: SH-080008, 8.3 and 8.4.
#pragma once

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// By 0403 or, where that is shorter and this PLC has it, by 0406. Bits are read as words of 16.
/// unsupported: no frame carries these reads.
Result<Bytes> encode_gather(const Dialect& dialect, const Gather& gather);
std::size_t gather_size(const Dialect& dialect, const Gather& gather);
/// The image of codec.h: part by part.
Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data);
/// Whether it goes by 0406.
bool goes_by_blocks(const Dialect& dialect, const Gather& gather);

/// By 1402: bits alone, or words and double words. unsupported: no frame carries these writes.
Result<Bytes> encode_scatter(const Dialect& dialect, const Scatter& scatter);

Write write_of(const Force& force);

}  // namespace fxagent::mc
