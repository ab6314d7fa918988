// Common part of the codecs of 1C, 1E, 3E, 4E, 3C and 4C: one object is codec, address space and
// PLC services, and has the dialect of its PLC and port.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "protocol/codec.h"
#include "protocol/mc/dialect.h"
#include "protocol/plc.h"

namespace fxagent::mc {

/// `Self` is the derived codec, which is made from a Dialect.
template <class Self>
class DialectCodec : public Codec, public AddressSpace, public PlcServices {
 public:
  using Settings = Dialect;

  std::string name_of(const Span& span) const override {
    return mc::device_name(settings_.model, span);
  }
  const AddressSpace& addresses() const override { return *this; }
  const PlcServices* plc() const override { return this; }
  bool is_text() const override { return settings_.code == Code::ascii; }

  std::string model() const override { return std::string(mc::to_string(settings_.model)); }
  std::shared_ptr<const Codec> with_model(std::string_view model) const override {
    const auto settings = mc::with_model(settings_, model);
    return settings ? made(*settings) : nullptr;
  }

 protected:
  explicit DialectCodec(const Dialect& settings) : settings_(settings) {}

  static std::shared_ptr<const Codec> made(const Dialect& settings) {
    return std::make_shared<const Self>(settings);
  }

  Dialect settings_;
};

}  // namespace fxagent::mc
