// What `commands.allow: RANGE` of `agent.remote_allow` gives a device of a remote config. The range
// is a text of the local file, and whoever sends devices chooses how they read it: Y0-Y17 is 16
// outputs of an FX and 24 of a Q, hr:300 is register 300 or 299. Pure.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "agent/config/config.h"
#include "protocol/catalog.h"
#include "protocol/device_numbers.h"

namespace fxagent {

class NamedRanges {
 public:
  /// `local` must outlive it.
  explicit NamedRanges(const Config& local);

  /// As the device itself reads the ranges: for one of the local file.
  std::vector<Span> as_read(const DeviceConfig& device) const;

  /// For any other device, which may be any machine, one of the local file by another name too: of
  /// what it reads itself, only what each device of the local file reads in the range as well, or
  /// lacks. Where none of them has such devices, what all models of its protocol agree on that can
  /// read the range, with its other options as they are by default.
  const std::vector<Span>& for_new(const DeviceConfig& device);

 private:
  /// One of the ways in which a machine of the plant understands names.
  struct Reader {
    const ProtocolInfo* protocol = nullptr;
    std::shared_ptr<const Codec> codec;
  };

  static void add_readers(std::vector<Reader>& readers, const ProtocolInfo& protocol,
                          const std::shared_ptr<const Codec>& codec);
  std::vector<Span> shared(const std::string& range, const DeviceConfig& device,
                           const Codec& codec) const;

  const RemoteLimits& limits_;
  std::vector<Reader> readers_;  ///< of the local file, each kind once
  std::map<const Codec*, std::vector<Span>> known_;
};

}  // namespace fxagent
