/* vst3_api.h: what this plugin uses of VST 3, declared from its specification: a table of functions for each interface, the
 * records that are handed over, the numbers. Names, order and layout are those of the specification, which is in C++: an object
 * is the address of a pointer to the table of its functions. On Windows the specification numbers results and orders the bytes of
 * ids as COM does.
 */
#ifndef JAWARI_VST3_API_H
#define JAWARI_VST3_API_H

#include <stdint.h>

/* ---- base ---- */

typedef int32_t tresult;
#if defined(_WIN32)
enum {
    kResultOk = 0,
    kResultFalse = 1,
    kNotImplemented = -0x7FFFBFFF, /* E_NOTIMPL, 0x80004001 */
    kNoInterface = -0x7FFFBFFE,    /* E_NOINTERFACE, 0x80004002 */
    kInternalError = -0x7FFFBFFB,  /* E_FAIL, 0x80004005 */
    kNotInitialized = -0x7FFF0001, /* E_UNEXPECTED, 0x8000FFFF */
    kOutOfMemory = -0x7FF8FFF2,    /* E_OUTOFMEMORY, 0x8007000E */
    kInvalidArgument = -0x7FF8FFA9 /* E_INVALIDARG, 0x80070057 */
};
#else
enum { kNoInterface = -1, kResultOk, kResultFalse, kInvalidArgument, kNotImplemented, kInternalError, kNotInitialized, kOutOfMemory };
#endif

typedef uint8_t TBool;
typedef uint8_t TUID[16];
typedef int16_t String128[128]; /* UTF-16 */

#define VST3_BYTES(word) (uint8_t)((word) >> 24 & 255), (uint8_t)((word) >> 16 & 255), (uint8_t)((word) >> 8 & 255), (uint8_t)((word) & 255)
#if defined(_WIN32)
#define VST3_ID(a, b, c, d)                                                                                                    \
    {(uint8_t)(a##u & 255), (uint8_t)(a##u >> 8 & 255), (uint8_t)(a##u >> 16 & 255), (uint8_t)(a##u >> 24 & 255),              \
     (uint8_t)(b##u >> 16 & 255), (uint8_t)(b##u >> 24 & 255), (uint8_t)(b##u & 255), (uint8_t)(b##u >> 8 & 255),              \
     VST3_BYTES(c##u), VST3_BYTES(d##u)}
#else
#define VST3_ID(a, b, c, d) {VST3_BYTES(a##u), VST3_BYTES(b##u), VST3_BYTES(c##u), VST3_BYTES(d##u)}
#endif

#define FUnknown_iid VST3_ID(0x00000000, 0x00000000, 0xC0000000, 0x00000046)
/* How every table begins. */
#define FUNKNOWN                                                 \
    tresult (*queryInterface)(void *, const TUID iid, void **obj); \
    uint32_t (*addRef)(void *);                                  \
    uint32_t (*release)(void *)

#define IPluginBase_iid VST3_ID(0x22888DDB, 0x156E45AE, 0x8358B348, 0x08190625)
#define IPLUGINBASE                                    \
    FUNKNOWN;                                          \
    tresult (*initialize)(void *, void *context); \
    tresult (*terminate)(void *)

typedef struct IBStream {
    FUNKNOWN;
    tresult (*read)(void *, void *buffer, int32_t size, int32_t *read);
    tresult (*write)(void *, void *buffer, int32_t size, int32_t *written);
    tresult (*seek)(void *, int64_t position, int32_t mode, int64_t *result);
    tresult (*tell)(void *, int64_t *position);
} IBStream;

/* ---- factory ---- */

enum { kUnicode = 1 << 4 };       /* PFactoryInfo.flags */
enum { kManyInstances = INT32_MAX }; /* cardinality */
enum { kSimpleModeSupported = 1 << 1 }; /* classFlags: processor and controller may live together */

typedef struct PFactoryInfo {
    char vendor[64], url[256], email[128];
    int32_t flags;
} PFactoryInfo;

typedef struct PClassInfo {
    TUID cid;
    int32_t cardinality;
    char category[32], name[64];
} PClassInfo;

typedef struct PClassInfo2 {
    TUID cid;
    int32_t cardinality;
    char category[32], name[64];
    uint32_t classFlags;
    char subCategories[128], vendor[64], version[64], sdkVersion[64];
} PClassInfo2;

typedef struct PClassInfoW {
    TUID cid;
    int32_t cardinality;
    char category[32];
    int16_t name[64];
    uint32_t classFlags;
    char subCategories[128];
    int16_t vendor[64], version[64], sdkVersion[64];
} PClassInfoW;

#define IPluginFactory_iid VST3_ID(0x7A4D811C, 0x52114A1F, 0xAED9D2EE, 0x0B43BF9F)
#define IPluginFactory2_iid VST3_ID(0x0007B650, 0xF24B4C0B, 0xA464EDB9, 0xF00B2ABB)
#define IPluginFactory3_iid VST3_ID(0x4555A2AB, 0xC1234E57, 0x9B122910, 0x36878931)
typedef struct IPluginFactory3 { /* which begins as the others do */
    FUNKNOWN;
    tresult (*getFactoryInfo)(void *, PFactoryInfo *info);
    int32_t (*countClasses)(void *);
    tresult (*getClassInfo)(void *, int32_t index, PClassInfo *info);
    tresult (*createInstance)(void *, const uint8_t *cid, const uint8_t *iid, void **obj);
    tresult (*getClassInfo2)(void *, int32_t index, PClassInfo2 *info);
    tresult (*getClassInfoUnicode)(void *, int32_t index, PClassInfoW *info);
    tresult (*setHostContext)(void *, void *context);
} IPluginFactory3;

/* ---- component ---- */

enum { kAudio, kEvent };        /* media */
enum { kInput, kOutput };       /* directions */
enum { kMain, kAux };           /* kinds of buses */
enum { kDefaultActive = 1 };    /* BusInfo.flags */
enum { kStereo = 3 };           /* speakers: left and right */
enum { kSample32, kSample64 };

typedef struct BusInfo {
    int32_t mediaType, direction, channelCount;
    String128 name;
    int32_t busType;
    uint32_t flags;
} BusInfo;

#define IComponent_iid VST3_ID(0xE831FF31, 0xF2D54301, 0x928EBBEE, 0x25697802)
typedef struct IComponent {
    IPLUGINBASE;
    tresult (*getControllerClassId)(void *, TUID cid);
    tresult (*setIoMode)(void *, int32_t mode);
    int32_t (*getBusCount)(void *, int32_t media, int32_t direction);
    tresult (*getBusInfo)(void *, int32_t media, int32_t direction, int32_t index, BusInfo *bus);
    tresult (*getRoutingInfo)(void *, void *in, void *out);
    tresult (*activateBus)(void *, int32_t media, int32_t direction, int32_t index, TBool on);
    tresult (*setActive)(void *, TBool on);
    tresult (*setState)(void *, const IBStream **stream);
    tresult (*getState)(void *, const IBStream **stream);
} IComponent;

/* ---- processor ---- */

typedef struct ProcessSetup {
    int32_t processMode, symbolicSampleSize, maxSamplesPerBlock;
    double sampleRate;
} ProcessSetup;

typedef struct AudioBusBuffers {
    int32_t numChannels;
    uint64_t silenceFlags;
    union {
        float **channelBuffers32;
        double **channelBuffers64;
    };
} AudioBusBuffers;

typedef struct IParamValueQueue {
    FUNKNOWN;
    uint32_t (*getParameterId)(void *);
    int32_t (*getPointCount)(void *);
    tresult (*getPoint)(void *, int32_t index, int32_t *offset, double *value);
    tresult (*addPoint)(void *, int32_t offset, double value, int32_t *index);
} IParamValueQueue;

typedef struct IParameterChanges {
    FUNKNOWN;
    int32_t (*getParameterCount)(void *);
    const IParamValueQueue **(*getParameterData)(void *, int32_t index);
    const IParamValueQueue **(*addParameterData)(void *, const uint32_t *id, int32_t *index);
} IParameterChanges;

enum { kNoteOnEvent, kNoteOffEvent, kDataEvent, kPolyPressureEvent, kNoteExpressionValueEvent };
enum { kMidiSysEx = 0 }; /* DataEvent.type */

typedef struct NoteOnEvent {
    int16_t channel, pitch;
    float tuning, velocity; /* cents; 0 … 1 */
    int32_t length, noteId;
} NoteOnEvent;

typedef struct NoteOffEvent {
    int16_t channel, pitch;
    float velocity;
    int32_t noteId;
    float tuning;
} NoteOffEvent;

typedef struct DataEvent {
    uint32_t size, type;
    const uint8_t *bytes;
} DataEvent;

typedef struct PolyPressureEvent {
    int16_t channel, pitch;
    float pressure;
    int32_t noteId;
} PolyPressureEvent;

typedef struct NoteExpressionValueEvent {
    uint32_t typeId;
    int32_t noteId;
    double value;
} NoteExpressionValueEvent;

typedef struct Event {
    int32_t busIndex, sampleOffset;
    double ppqPosition;
    uint16_t flags, type;
    union {
        NoteOnEvent noteOn;
        NoteOffEvent noteOff;
        DataEvent data;
        PolyPressureEvent polyPressure;
        NoteExpressionValueEvent noteExpressionValue;
    };
} Event;

typedef struct IEventList {
    FUNKNOWN;
    int32_t (*getEventCount)(void *);
    tresult (*getEvent)(void *, int32_t index, Event *event);
    tresult (*addEvent)(void *, Event *event);
} IEventList;

enum { /* ProcessContext.state */
    kPlaying = 1 << 1,
    kProjectTimeMusicValid = 1 << 9,
    kTempoValid = 1 << 10
};

typedef struct ProcessContext {
    uint32_t state;
    double sampleRate;
    int64_t projectTimeSamples, systemTime, continousTimeSamples;
    double projectTimeMusic; /* quarter notes */
    double barPositionMusic, cycleStartMusic, cycleEndMusic;
    double tempo; /* quarter notes a minute */
    int32_t timeSigNumerator, timeSigDenominator;
    uint8_t chordKeyNote, chordRootNote;
    int16_t chordMask;
    int32_t smpteOffsetSubframes;
    uint32_t framesPerSecond, frameRateFlags;
    int32_t samplesToNextClock;
} ProcessContext;

typedef struct ProcessData {
    int32_t processMode, symbolicSampleSize, numSamples, numInputs, numOutputs;
    AudioBusBuffers *inputs, *outputs;
    const IParameterChanges **inputParameterChanges, **outputParameterChanges;
    const IEventList **inputEvents, **outputEvents;
    const ProcessContext *processContext; /* NULL: the host has no transport */
} ProcessData;

#define IAudioProcessor_iid VST3_ID(0x42043F99, 0xB7DA453C, 0xA569E79D, 0x9AAEC33D)
typedef struct IAudioProcessor {
    FUNKNOWN;
    tresult (*setBusArrangements)(void *, const uint64_t *inputs, int32_t ins, const uint64_t *outputs, int32_t outs);
    tresult (*getBusArrangement)(void *, int32_t direction, int32_t index, uint64_t *arrangement);
    tresult (*canProcessSampleSize)(void *, int32_t size);
    uint32_t (*getLatencySamples)(void *);
    tresult (*setupProcessing)(void *, const ProcessSetup *setup);
    tresult (*setProcessing)(void *, TBool on);
    tresult (*process)(void *, ProcessData *data);
    uint32_t (*getTailSamples)(void *);
} IAudioProcessor;

#define IProcessContextRequirements_iid VST3_ID(0x2A654303, 0xEF764E3D, 0x95B5FE83, 0x730EF6D0)
enum { kNeedProjectTimeMusic = 1 << 2, kNeedTempo = 1 << 6, kNeedTransportState = 1 << 10 };
typedef struct IProcessContextRequirements {
    FUNKNOWN;
    uint32_t (*getProcessContextRequirements)(void *);
} IProcessContextRequirements;

/* ---- controller ---- */

enum { /* ParameterInfo.flags */
    kCanAutomate = 1 << 0,
    kIsReadOnly = 1 << 1,
    kIsList = 1 << 3,
    kIsHidden = 1 << 4,
    kIsProgramChange = 1 << 15,
    kIsBypass = 1 << 16
};

typedef struct ParameterInfo {
    uint32_t id;
    String128 title, shortTitle, units;
    int32_t stepCount; /* maximum − minimum of whole numbers; 0: continuous */
    double defaultNormalizedValue;
    int32_t unitId, flags;
} ParameterInfo;

#define IEditController_iid VST3_ID(0xDCD7BBE3, 0x7742448D, 0xA874AACC, 0x979C759E)
typedef struct IEditController {
    IPLUGINBASE;
    tresult (*setComponentState)(void *, const IBStream **stream);
    tresult (*setState)(void *, const IBStream **stream);
    tresult (*getState)(void *, const IBStream **stream);
    int32_t (*getParameterCount)(void *);
    tresult (*getParameterInfo)(void *, int32_t index, ParameterInfo *info);
    tresult (*getParamStringByValue)(void *, uint32_t id, double normalized, String128 text);
    tresult (*getParamValueByString)(void *, uint32_t id, const int16_t *text, double *normalized);
    double (*normalizedParamToPlain)(void *, uint32_t id, double normalized);
    double (*plainParamToNormalized)(void *, uint32_t id, double plain);
    double (*getParamNormalized)(void *, uint32_t id);
    tresult (*setParamNormalized)(void *, uint32_t id, double normalized);
    tresult (*setComponentHandler)(void *, void *handler);
    void *(*createView)(void *, const char *name);
} IEditController;

enum { kAfterTouch = 128, kPitchBend = 129, kCtrlProgramChange = 130 }; /* beyond MIDI's controllers */

#define IMidiMapping_iid VST3_ID(0xDF0FF9F7, 0x49B74669, 0xB63AB732, 0x7ADBF5E5)
typedef struct IMidiMapping {
    FUNKNOWN;
    tresult (*getMidiControllerAssignment)(void *, int32_t bus, int16_t channel, int16_t controller, uint32_t *id);
} IMidiMapping;

enum { kRootUnitId = 0, kNoParentUnitId = -1, kNoProgramListId = -1 };

typedef struct UnitInfo {
    int32_t id, parentUnitId;
    String128 name;
    int32_t programListId;
} UnitInfo;

typedef struct ProgramListInfo {
    int32_t id;
    String128 name;
    int32_t programCount;
} ProgramListInfo;

#define IUnitInfo_iid VST3_ID(0x3D4BD6B5, 0x913A4FD2, 0xA886E768, 0xA5EB92C1)
typedef struct IUnitInfo {
    FUNKNOWN;
    int32_t (*getUnitCount)(void *);
    tresult (*getUnitInfo)(void *, int32_t index, UnitInfo *info);
    int32_t (*getProgramListCount)(void *);
    tresult (*getProgramListInfo)(void *, int32_t index, ProgramListInfo *info);
    tresult (*getProgramName)(void *, int32_t list, int32_t program, String128 name);
    tresult (*getProgramInfo)(void *, int32_t list, int32_t program, const char *attribute, String128 value);
    tresult (*hasProgramPitchNames)(void *, int32_t list, int32_t program);
    tresult (*getProgramPitchName)(void *, int32_t list, int32_t program, int16_t pitch, String128 name);
    int32_t (*getSelectedUnit)(void *);
    tresult (*selectUnit)(void *, int32_t unit);
    tresult (*getUnitByBus)(void *, int32_t media, int32_t direction, int32_t bus, int32_t channel, int32_t *unit);
    tresult (*setUnitProgramData)(void *, int32_t list, int32_t program, const IBStream **data);
} IUnitInfo;

enum { kTuningTypeID = 2, kBrightnessTypeID = 5, kCustomStart = 100000 }; /* note expressions */
enum { kIsBipolar = 1 << 0 };                                            /* NoteExpressionTypeInfo.flags */

typedef struct NoteExpressionValueDescription {
    double defaultValue, minimum, maximum;
    int32_t stepCount;
} NoteExpressionValueDescription;

typedef struct NoteExpressionTypeInfo {
    uint32_t typeId;
    String128 title, shortTitle, units;
    int32_t unitId;
    NoteExpressionValueDescription valueDesc;
    uint32_t associatedParameterId;
    int32_t flags;
} NoteExpressionTypeInfo;

#define INoteExpressionController_iid VST3_ID(0xB7F8F859, 0x41234872, 0x91169581, 0x4F3721A3)
typedef struct INoteExpressionController {
    FUNKNOWN;
    int32_t (*getNoteExpressionCount)(void *, int32_t bus, int16_t channel);
    tresult (*getNoteExpressionInfo)(void *, int32_t bus, int16_t channel, int32_t index, NoteExpressionTypeInfo *info);
    tresult (*getNoteExpressionStringByValue)(void *, int32_t bus, int16_t channel, uint32_t type, double value, String128 text);
    tresult (*getNoteExpressionValueByString)(void *, int32_t bus, int16_t channel, uint32_t type, const int16_t *text, double *value);
} INoteExpressionController;

#endif
