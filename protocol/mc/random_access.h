// Scattered places in one frame: 0403 (random read), 0406 (blocks) and 1402 (random write). Only
// for the files of this codec.
// Source: SH-080008, 8.3 and 8.4.
#pragma once

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// Encodes a Gather by 0403 or 0406, according to its parts. Error: bad_request if it exceeds the
/// limits or mixes parts of both.
Result<Bytes> encode_gather(const Dialect& dialect, const Gather& gather);
std::size_t gather_size(const Dialect& dialect, const Gather& gather);
/// Returns the image of a Gather reply (codec.h), part after part.
Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data);
/// Returns one Gather for `reads`, whatever their ways; nullopt if no frame can carry them.
std::optional<Gather> gathered(const Dialect& dialect, const std::vector<Read>& reads);

/// Encodes a Scatter by 1402: only bits, or words and double words. Error: unsupported if no frame
/// can carry these writes.
Result<Bytes> encode_scatter(const Dialect& dialect, const Scatter& scatter);

}  // namespace fxagent::mc
