// Scattered places in one frame: 0403 (random read), 0406 (blocks) and 1402 (random write). For the
// codec's own files.
// Source: SH-080008, 8.3 and 8.4.
#pragma once

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"

namespace fxagent::mc {

/// By 0403 or 0406, as its parts say. bad_request: out of the limits, or parts of both.
Result<Bytes> encode_gather(const Dialect& dialect, const Gather& gather);
std::size_t gather_size(const Dialect& dialect, const Gather& gather);
/// The image of codec.h: part by part.
Result<Bytes> decode_gather(const Dialect& dialect, const Gather& gather, ByteView data);
/// One Gather of reads by any way; nullopt where no frame carries them.
std::optional<Gather> gathered(const Dialect& dialect, const std::vector<Read>& reads);

/// By 1402: bits alone, or words and double words. unsupported: no frame carries these writes.
Result<Bytes> encode_scatter(const Dialect& dialect, const Scatter& scatter);

}  // namespace fxagent::mc
