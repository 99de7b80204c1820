// Memory that a thread keeps between frames, so that no frame pays for fresh pages.
#pragma once

#include <cstddef>
#include <memory>

namespace recorder {

template <typename T>
class Scratch {
  public:
    // At least `count` elements, not initialised, valid until the next call.
    T *reserve(std::size_t count) {
        if (count > capacity_) {
            memory_.reset();
            capacity_ = 0;
            memory_.reset(new T[count]);
            capacity_ = count;
        }
        return memory_.get();
    }

  private:
    template <typename>
    friend class Trim;

    // Gives back what no camera needs.
    void trim() {
        constexpr std::size_t kept_bytes = std::size_t{64} << 20;
        if (capacity_ * sizeof(T) > kept_bytes) {
            memory_.reset();
            capacity_ = 0;
        }
    }

    std::unique_ptr<T[]> memory_;
    std::size_t capacity_ = 0;
};

// At the end of its scope, however that is left, one huge image is no longer paid for.
template <typename T>
class Trim {
  public:
    explicit Trim(Scratch<T> &scratch) : scratch_(scratch) {}
    ~Trim() { scratch_.trim(); }
    Trim(const Trim &) = delete;
    Trim &operator=(const Trim &) = delete;

  private:
    Scratch<T> &scratch_;
};

}  // namespace recorder
